"""The DQN-SNN controller (paper section 3.5): a spiking network that took over a Q-network."""
