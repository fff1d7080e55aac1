"""highway-env's unsignalised crossing (thesis 5.1.3), compiled, with identical episodes."""
