"""Network namespaces as hosts on one machine: a campaign's computers, their links, and a cluster on them."""
