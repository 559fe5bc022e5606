"""How the sample policy for the piano is made: what a network learns is which hand takes which note, and when."""
