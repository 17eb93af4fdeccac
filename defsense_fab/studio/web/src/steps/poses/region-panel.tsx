// The fields of the selected region.
import type { RegionState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { MenuButton } from "../../ui/menu";
import { NumberField } from "../../ui/number-field";
import { SelectField } from "../../ui/select-field";
import { rename } from "../../shell/rename";
import { TextField } from "../../ui/text-field";
import { Section } from "../../ui/section";
import { regionMenu, type ShapeKind, SHAPES } from "./commands";
import { startRectangle } from "./rectangle";
import { type RegionShape, middle } from "./region-geometry";
import { isMeshed, posesState, sceneTool } from "./state";
import { VectorField } from "./vector-field";

const POINT_NAMES: Record<ShapeKind, readonly string[]> = {
  box: ["Lowest corner", "Highest corner"],
  sphere: ["Center"],
  "half-space": ["Point of the plane", "Direction"],
  cylinder: ["Start", "End"],
};

export function RegionPanel({ region }: { region: RegionState }) {
  const send = (shape: RegionShape) =>
    connection.send("set-region", {
      region: region.name,
      shape: shape.shape,
      points: shape.points,
      radius: shape.radius,
    });
  return (
    <>
      <header class="item-header">
        <span class="swatch region" style={{ background: region.color }} />
        <h2>{region.name}</h2>
        <MenuButton label={`Actions for ${region.name}`} entries={regionMenu} />
      </header>
      <Section title="Region" name="region.shape">
        <TextField label="Name" value={region.name} onCommit={(name) => rename("region", region.name, name)} />
        <SelectField
          label="Shape"
          value={region.shape}
          choices={SHAPES}
          onCommit={(shape) => send(converted(region, shape, posesState.value?.size ?? 100))}
        />
        {region.points.map((point, index) => (
          <VectorField
            key={`${region.shape}${index}`}
            label={POINT_NAMES[region.shape][index]!}
            value={point}
            unit={region.shape === "half-space" && index === 1 ? "" : "mm"}
            onCommit={(value) =>
              send({ ...region, points: region.points.map((other, i) => (i === index ? value : other)) })
            }
          />
        ))}
        {(region.shape === "sphere" || region.shape === "cylinder") && (
          <NumberField
            label="Radius"
            value={region.radius}
            unit="mm"
            above={0}
            onCommit={(radius) => send({ ...region, radius })}
          />
        )}
      </Section>
      {isMeshed.value && (
        <Section title="Surface points" name="region.points" aside={region.count}>
          {region.problems.map((text) => (
            <p key={text} class="warning-text">
              <Icon name="warning" size={14} /> <span>{text}</span>
            </p>
          ))}
          <div class="button-row">
            <Button
              icon="select"
              aria-pressed={sceneTool.value === "rectangle"}
              hint="Draw a rectangle over the body; a box is fitted to the points in it"
              onClick={() => startRectangle(true)}
            >
              Fit to a rectangle
            </Button>
            {region.shape !== "box" && (
              <Button
                hint="Fit a box to the points in the region"
                onClick={() => void run(connection.send("convert-region", { region: region.name }))}
              >
                Convert to a box
              </Button>
            )}
          </div>
        </Section>
      )}
      <Section title="Used by" name="region.used" aside={region.poses.length}>
        {region.poses.length === 0 && <p class="muted">No pose uses this region.</p>}
        <div class="button-row">
          {region.poses.map((name) => (
            <Button key={name} variant="quiet" icon="pose" onClick={() => select({ kind: "pose", name })}>
              {name}
            </Button>
          ))}
        </div>
      </Section>
    </>
  );
}

/** A region with another shape, at the same place and of about the same size. */
function converted(region: RegionState, shape: ShapeKind, size: number): RegionShape {
  const center = middle(region);
  const round = (value: number) => Math.round(value * 10) / 10;
  const isBounded = region.shape === "box" || region.shape === "cylinder";
  const extent = isBounded
    ? region.points[0]!.map((value, k) => Math.abs(region.points[1]![k]! - value) / 2)
    : center.map(() => region.radius || 0.1 * size);
  const half = extent.map((value) => Math.max(value, region.shape === "cylinder" ? region.radius : 0.1));
  const at = (sign: number) => center.map((value, k) => round(value + sign * half[k]!));
  const main = half.indexOf(Math.max(...half));
  const axis = center.map((_, k) => (k === main ? 1 : 0));
  const end = (sign: number) => center.map((value, k) => round(value + sign * half[k]! * axis[k]!));
  const across = Math.max(...half.map((value, k) => (k === main ? 0 : value)));
  if (shape === "box") return { shape, points: [at(-1), at(1)], radius: 0 };
  if (shape === "sphere") return { shape, points: [center.map(round)], radius: round(Math.max(...half)) };
  if (shape === "half-space") return { shape, points: [center.map(round), axis], radius: 0 };
  return { shape, points: [end(-1), end(1)], radius: round(across) };
}
