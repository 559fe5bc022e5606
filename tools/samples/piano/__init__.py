"""The sample policy for the piano: a network learns which hand takes which note, and when."""
