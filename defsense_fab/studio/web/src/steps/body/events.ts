// What the server sends for this step.
import { connection } from "../../state/connection";

export const bodyStatus = connection.event("body-status");
export const bodyParameters = connection.event("body-parameters");
export const catalogues = connection.event("catalogues");
export const deviceFields = connection.event("device-fields");
