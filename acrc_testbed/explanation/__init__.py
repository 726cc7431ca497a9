"""Why a robot decided as it did: from a decision back to knowledge, replicas and frames."""
