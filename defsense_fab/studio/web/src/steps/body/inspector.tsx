import { CatalogueChoices } from "./catalogue-choices";
import { BodySummary } from "./body-summary";
import { FieldGroups } from "./field-groups";
import { ParameterSection } from "./parameter-section";

/** What the device is made of: body, materials, and fields. */
export function BodyInspector() {
  return (
    <div class="body-inspector">
      <BodySummary />
      <ParameterSection />
      <CatalogueChoices />
      <FieldGroups />
    </div>
  );
}
