"""What a person sees of a diagnosis: the ledger of before and after, and pictures that show why."""
