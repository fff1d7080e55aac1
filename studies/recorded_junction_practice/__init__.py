"""Study of a dial at a recorded junction, trained from demonstrations alone."""
