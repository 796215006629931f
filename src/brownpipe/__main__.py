"""`python -m brownpipe`."""

import sys

from brownpipe.cli import main

sys.exit(main())
