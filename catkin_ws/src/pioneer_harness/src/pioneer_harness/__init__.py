"""Test and demo harness: masters on free ports, waiting for conditions, process groups that always clean up."""
