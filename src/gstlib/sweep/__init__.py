"""What moves the results most? A study again and again, each time with one thing set otherwise."""
