"""Generate candidate cords and select layouts from them."""
