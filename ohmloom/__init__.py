"""Can this evolved spiking controller be built out of real memristors, and will it still do its job?"""

import logging

__version__ = "0.1.0"

logging.getLogger(__name__).addHandler(logging.NullHandler())
