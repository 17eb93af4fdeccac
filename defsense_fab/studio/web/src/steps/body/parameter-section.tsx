import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { bodyParameters } from "./events";
import { ParameterField } from "./parameter-field";

/** The parameters of the body's script. */
export function ParameterSection() {
  const event = bodyParameters.value;
  if (!event) return null;
  const { file, source, parameters, other, unknown, problem } = event;
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
      {!problem && parameters.length === 0 && (
        <p class="field-help">
          {source === "script"
            ? "The script's function body has no parameters with fields."
            : "The body is a file: “Scale of the file”, below in “Body file”, changes its size."}
        </p>
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
