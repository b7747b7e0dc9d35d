"""A transfer: a controller takes over what another one has learnt."""
