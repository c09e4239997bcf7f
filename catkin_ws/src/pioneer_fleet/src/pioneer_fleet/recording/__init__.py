"""Recording of topics of several masters; replay on a master and in the browser."""
