"""`python -m axistwin` is `axistwin`."""

import sys

from axistwin.cli import main

sys.exit(main())
