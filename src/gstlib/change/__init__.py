"""Material lost in use: T1 registered to T0, and the texture before and after."""
