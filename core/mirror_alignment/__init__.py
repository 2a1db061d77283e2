"""Mirror planes corrected until what the views show fits together."""
