"""What the regularized objective does, exactly: closed forms and a reliable minimiser."""
