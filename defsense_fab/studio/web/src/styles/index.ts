import "./tokens.css";
import "./base.css";
import "./controls.css";
import "./fields.css";
import "./overlays.css";
import "./shell.css";
import "./tree.css";
import "./phone.css";
