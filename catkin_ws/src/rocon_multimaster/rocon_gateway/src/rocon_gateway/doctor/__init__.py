"""The doctor: facts about the links of gateways, the diagnosis, the command, and the reply to its requests."""
