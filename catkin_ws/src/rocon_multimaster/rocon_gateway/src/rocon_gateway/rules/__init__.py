"""Rules: matching, the rule book, and `reconcile`, which computes links, requests and rule states."""
