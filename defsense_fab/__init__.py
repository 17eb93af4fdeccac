"""Design, fabrication and use of soft objects that sense their own deformation."""

__version__ = "0.1.0"
