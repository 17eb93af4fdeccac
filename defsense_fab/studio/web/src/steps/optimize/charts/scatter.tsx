// Layouts as dots: the error over what they cost. A dot is a button.
import { useRef } from "preact/hooks";
import { Axes, type Frame } from "./axes";
import { countScale, linearScale, logScale } from "./scale";
import { useSize } from "./use-size";

export type Tone = "drawn" | "built" | "other" | "earlier";

export interface Dot {
  name: string;
  /** What is read out and shown next to the dot. */
  label: string;
  x: number;
  y: number;
  tone: Tone;
  isChosen: boolean;
}

interface ScatterProps {
  dots: readonly Dot[];
  xTitle: string;
  yTitle: string;
  /** Whether the axis of x has whole numbers only. */
  areCounts: boolean;
  onChoose: (name: string) => void;
  onHover: (name: string | null) => void;
}

const MARGINS = { left: 40, right: 14, top: 26, bottom: 34 };
const SPREAD_PX = 17; // between dots of the same place

/** A chart of dots; arrow keys move between them in the order of the axis. */
export function Scatter({ dots, xTitle, yTitle, areCounts, onChoose, onHover }: ScatterProps) {
  const host = useRef<HTMLDivElement>(null);
  const [width, height] = useSize(host);
  const frame: Frame = { width, height, ...MARGINS };
  const xs = dots.map((dot) => dot.x);
  const [start, end] = [frame.left, width - frame.right];
  const x = areCounts ? countScale(xs, start, end) : linearScale(xs, start, end, 0.12);
  const y = logScale(dots.map((dot) => dot.y), height - frame.bottom, frame.top);
  const placed = apart(dots.map((dot) => ({ dot, px: x.at(dot.x), py: y.at(dot.y) })));
  const order = [...placed].sort((a, b) => a.px - b.px || b.py - a.py);
  const entry = placed.find(({ dot }) => dot.isChosen) ?? order[0];

  const move = (event: KeyboardEvent, name: string) => {
    const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key] ?? 0;
    const from = order.findIndex(({ dot }) => dot.name === name);
    const next = order[from + by];
    if (by === 0) {
      if (event.key !== "Enter" && event.key !== " ") return;
      onChoose(name);
    } else if (next) {
      const dots = host.current!.querySelectorAll<SVGElement>("[data-dot]");
      [...dots].find((element) => element.dataset.dot === next.dot.name)?.focus();
    }
    event.preventDefault();
    event.stopPropagation();
  };

  return (
    <div class="chart" ref={host}>
      {width > 0 && (
        <svg width={width} height={height} role="group" aria-label={`${yTitle} over ${xTitle}`}>
          <Axes frame={frame} x={x} y={y} xTitle={xTitle} yTitle={yTitle} />
          {placed.map(({ dot, px, py }) => (
            <g
              key={dot.name}
              class={`chart-dot ${dot.tone} ${dot.isChosen ? "chosen" : ""}`}
              role="button"
              data-dot={dot.name}
              tabIndex={dot.name === entry?.dot.name ? 0 : -1}
              aria-label={dot.label}
              aria-pressed={dot.isChosen}
              data-tooltip={dot.label}
              onClick={() => onChoose(dot.name)}
              onKeyDown={(event) => move(event, dot.name)}
              onPointerEnter={() => onHover(dot.name)}
              onPointerLeave={() => onHover(null)}
              onFocus={() => onHover(dot.name)}
              onBlur={() => onHover(null)}
            >
              <circle class="chart-dot-target" cx={px} cy={py} r={8.5} />
              <circle class="chart-dot-mark" cx={px} cy={py} r={dot.isChosen ? 6.5 : 5} />
            </g>
          ))}
        </svg>
      )}
    </div>
  );
}

interface Placed {
  dot: Dot;
  px: number;
  py: number;
}

/** Move dots that cover each other apart, sideways. */
function apart(dots: Placed[]): Placed[] {
  const done: Placed[] = [];
  for (const dot of dots) {
    let px = dot.px;
    for (let k = 1; done.some((other) => Math.hypot(other.px - px, other.py - dot.py) < SPREAD_PX); k++) {
      px = dot.px + SPREAD_PX * Math.ceil(k / 2) * (k % 2 ? 1 : -1);
    }
    done.push({ ...dot, px });
  }
  return done;
}
