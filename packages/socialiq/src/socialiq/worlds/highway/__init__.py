"""Other roads of highway-env, compiled, with identical episodes; `scenes` has them."""
