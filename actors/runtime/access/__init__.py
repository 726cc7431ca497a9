"""Who may use which key of the mesh: rules, credentials, TLS, and what the router is told."""
