// Registers the panels of all steps.
import "./overviews";
import "./inside";
