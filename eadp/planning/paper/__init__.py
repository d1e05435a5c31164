"""The letter's Algorithm 2: receding-horizon problem and path rule."""
