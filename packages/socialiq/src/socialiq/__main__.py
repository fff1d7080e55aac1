"""`python -m socialiq`."""

import sys

from socialiq.cli.main import main

sys.exit(main())
