"""Was the prediction right? T1 against T0 against the predicted contact."""
