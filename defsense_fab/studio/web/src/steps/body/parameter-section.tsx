import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { DeviceFieldRow } from "./device-field";
import { bodyParameters, deviceFields } from "./events";
import { ParameterField } from "./parameter-field";

/** Key of the field that is the only parameter of a body from a file. */
export const SCALE = "body.scale";

/** The parameters of the body's script, or the scale of its file. */
export function ParameterSection() {
  const event = bodyParameters.value;
  if (!event) return null;
  const { file, source, parameters, other, unknown, problem } = event;
  const scale = deviceFields.value?.groups
    .flatMap(({ fields, more }) => [...fields, ...more])
    .find(({ key }) => key === SCALE);
  return (
    <Section title="Parameters" name="body.parameters" aside={<code>{file}</code>}>
      {problem && (
        <p class="field-error" role="alert">
          <Icon name="error" size={14} /> <span>{problem.text}</span>
        </p>
      )}
      {parameters.map((parameter) => (
        <ParameterField key={parameter.name} parameter={parameter} />
      ))}
      {scale && <DeviceFieldRow field={scale} />}
      {!problem && source === "script" && parameters.length === 0 && (
        <p class="field-help">The script's function body has no parameters with fields.</p>
      )}
      {other.length > 0 && (
        <p class="field-help">Other parameters, set in device.toml only: {other.join(", ")}.</p>
      )}
      {unknown.length > 0 && (
        <p class="field-help warning">
          device.toml sets {unknown.join(", ")}, which the script's body does not accept.
        </p>
      )}
    </Section>
  );
}
