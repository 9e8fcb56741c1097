"""What a person sees of a posterior."""
