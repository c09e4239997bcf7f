"""Scripts that advertise, pull and flip the fleet's topics."""
