"""How parts are made: what lies on the plates, moulds and silicone, advice for the printer."""
