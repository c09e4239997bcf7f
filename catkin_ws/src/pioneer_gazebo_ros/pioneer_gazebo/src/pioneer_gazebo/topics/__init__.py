"""Topics of robots: one module a kind of device, and the robots that carry them."""
