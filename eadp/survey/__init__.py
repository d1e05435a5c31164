"""Field surveys: cover, sorties, what is left."""
