"""The page: the dial turned in a browser, with the compiled core itself as WebAssembly."""
