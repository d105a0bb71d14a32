"""`python -m axistwin.paper`."""

import sys

from axistwin.paper.runner import main

if __name__ == "__main__":
    sys.exit(main())
