"""The state of a flight: what the readings show of wind, power, time, charge and ground so far."""
