// The legend of a section: its colors from end to end, and what they mean.
import { useEffect, useRef } from "preact/hooks";
import { Checkbox } from "../../ui/choices";
import { type ColorScale, formatValue } from "./color-scale";
import { type NextCordTool, search } from "./next-cord";
import { inside, type SectionData, type SectionView } from "./section-view";

const BAR = { width: 204, height: 12 };
/** Values count as beyond the range if they are farther than this share of it. */
const BEYOND = 0.02;
/** Width of a digit of a tick and the smallest gap between two ticks, px. */
const DIGIT_PX = 7;
const TICK_GAP_PX = 8;

interface SectionLegendProps {
  view: SectionView;
  /** The search, if the legend shows what a cord under the pointer would change. */
  tool?: NextCordTool;
}

/** The color bar of a section, for the lower left of the scene. */
export function SectionLegend({ view, tool }: SectionLegendProps) {
  const { value: scale } = view.scale;
  const { value: info } = view.info;
  const { value: section } = view.section;
  if (!inside.value?.isReady || !info) return null;
  const isGain = info.name === "next-cord";
  const hovered = view.hover.value?.value;
  const text = tool && view.hover.value ? tool.textAt(view.hover.value.rest) : "";
  return (
    <figure class="section-legend" aria-label={`Colors: ${info.label}`}>
      <figcaption>
        {info.label}
        {info.needsDirection && <> {directionText(view)}</>}, {info.unit}
      </figcaption>
      {view.problem.value ? (
        <p class="legend-problem" role="status">
          {view.problem.value}
        </p>
      ) : (
        scale &&
        section &&
        (section.smallest === null ? (
          <p class="legend-note">{noValueText()}</p>
        ) : (
          <>
            <ColorBar scale={scale} section={section} hovered={hovered} />
            {isGain ? (
              <p class="legend-note">
                {!text && <span class="legend-unknown" style={{ background: unknownColor() }} />}
                {text || "None fits"}
              </p>
            ) : (
              <p class="legend-note">
                In this section {rangeText(section.smallest, section.largest, scale)} {info.unit}
              </p>
            )}
          </>
        ))
      )}
      {!isGain && (
        <Checkbox
          label="Fixed over all states"
          hint="Keep the same colors for all states and planes, to compare them"
          isOn={view.isRangeFixed.value}
          onChange={(isOn) => (view.isRangeFixed.value = isOn)}
        />
      )}
    </figure>
  );
}

interface ColorBarProps {
  scale: ColorScale;
  section: SectionData;
  /** Value under the pointer. */
  hovered: number | undefined;
}

function ColorBar({ scale, section, hovered }: ColorBarProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => draw(canvas.current!, scale), [scale]);
  const ticks = labeledTicks(scale);
  const { low, high } = scale.range;
  const margin = BEYOND * (high - low);
  const percent = (value: number) => `${100 * scale.shareOf(value)}%`;
  return (
    <div class="section-bar" style={{ width: `${BAR.width}px` }}>
      <canvas ref={canvas} width={BAR.width} height={1} style={{ height: `${BAR.height}px` }} />
      {hovered !== undefined && !Number.isNaN(hovered) && (
        <span class="bar-marker" style={{ left: percent(hovered) }} />
      )}
      {ticks.map((value, k) => (
        <span key={value} class="bar-tick" style={{ left: percent(value) }}>
          {k === 0 && (section.smallest ?? low) < low - margin && "\u2264"}
          {k === ticks.length - 1 && (section.largest ?? high) > high + margin && "\u2265"}
          {formatValue(value, scale.range)}
        </span>
      ))}
    </div>
  );
}

/** The ticks that have room for their numbers; 0 is one of them. */
function labeledTicks(scale: ColorScale): number[] {
  const ticks = scale.ticks();
  const { low, high, step } = scale.range;
  const digits = Math.max(...ticks.map((value) => formatValue(value, scale.range).length)) + 1;
  const spacing = (BAR.width * step) / (high - low);
  const every = Math.max(1, Math.ceil((digits * DIGIT_PX + TICK_GAP_PX) / spacing));
  return ticks.filter((value) => Math.round(value / step) % every === 0);
}

/** Paint each pixel with the color that the section has for its value. */
function draw(canvas: HTMLCanvasElement, scale: ColorScale): void {
  const context = canvas.getContext("2d")!;
  const image = context.createImageData(BAR.width, 1);
  const { low, high } = scale.range;
  for (let x = 0; x < BAR.width; x++) {
    const index = scale.indexOf(low + ((x + 0.5) / BAR.width) * (high - low));
    image.data.set(scale.table.subarray(4 * index, 4 * index + 4), 4 * x);
  }
  context.putImageData(image, 0, 0);
}

function noValueText(): string {
  if (search.value?.state === "searching") return "Searching...";
  return search.value?.state === "found" ? "None fits in this plane" : "Not searched";
}

function unknownColor(): string {
  return `rgb(${(inside.value?.unknownColor ?? []).join()})`;
}

function directionText(view: SectionView): string {
  const cord = view.cord.value;
  return cord ? `(${cord})` : `(${Math.round(view.angle.value)}\u00b0)`;
}

function rangeText(low: number | null, high: number | null, { range }: ColorScale): string {
  if (low === null || high === null) return "no value";
  return `${formatValue(low, range, true)} to ${formatValue(high, range, true)}`;
}
