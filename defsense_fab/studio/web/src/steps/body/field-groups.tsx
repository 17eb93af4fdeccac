import type { FieldGroup } from "../../protocol/messages";
import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { DeviceFieldRow } from "./device-field";
import { deviceFields } from "./events";
import { SCALE } from "./parameter-section";

/** The fields of the device, by table; rare ones under "More". */
export function FieldGroups() {
  return (
    <>
      {deviceFields.value?.groups.map((group) => (
        <Group key={group.title} group={group} />
      ))}
    </>
  );
}

function Group({ group: { title, fields, more: rare } }: { group: FieldGroup }) {
  const more = rare.filter(({ key }) => key !== SCALE);
  const isRare = fields.length === 0;
  const changed = [...fields, ...more].filter(({ canReset }) => canReset).length;
  const isMoreChanged = more.some(({ canReset }) => canReset);
  return (
    <Section
      title={title}
      name={`body.${title}`}
      isOpenAtFirst={!isRare}
      aside={changed > 0 ? `${changed} changed` : undefined}
    >
      {fields.map((field) => (
        <DeviceFieldRow key={field.key} field={field} />
      ))}
      {isRare && more.map((field) => <DeviceFieldRow key={field.key} field={field} />)}
      {!isRare && more.length > 0 && (
        <details class="more-fields" open={isMoreChanged || undefined}>
          <summary>
            <Icon name="chevronRight" size={14} /> More
            <span class="visually-hidden"> fields: {title}</span>
          </summary>
          {more.map((field) => (
            <DeviceFieldRow key={field.key} field={field} />
          ))}
        </details>
      )}
    </Section>
  );
}
