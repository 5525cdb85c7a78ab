"""The paper's own perception: adaptive threshold and exponential moving average."""
