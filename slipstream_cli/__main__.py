"""`python -m slipstream_cli` is `slipstream`."""

import sys

from slipstream_cli.main import main

if __name__ == "__main__":
    sys.exit(main())
