"""The core as WebAssembly beside the native one: `python -m tests.page_core.equality`."""
