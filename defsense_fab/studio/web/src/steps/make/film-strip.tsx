// The steps of the assembly as a film strip, with a tick box for each.
import { useEffect, useRef } from "preact/hooks";
import type { GuideStage } from "../../protocol/messages";
import { doneCount, isDone, showStage, stageIndex, stages, tick } from "./state";
import { ALL_PARTS, thumbnails } from "./thumbnails";

/** What stays visible of the steps next to the shown one. */
const NEIGHBOR_PX = 60;

/** The steps in their order; arrow keys move between them. */
export function FilmStrip() {
  const list = useRef<HTMLOListElement>(null);
  const shown = stageIndex.value;
  useEffect(() => {
    const strip = list.current;
    const card = strip?.children[shown + 1];
    if (!strip || !(card instanceof HTMLElement)) return;
    const [left, right] = [card.offsetLeft - NEIGHBOR_PX, card.offsetLeft + card.offsetWidth + NEIGHBOR_PX];
    const isVisible = left >= strip.scrollLeft && right <= strip.scrollLeft + strip.clientWidth;
    if (!isVisible) strip.scrollTo({ left, behavior: "smooth" });
  }, [shown]);
  if (stages.value.length === 0) {
    return <p class="film-empty">The steps of the assembly appear here once the parts are built.</p>;
  }
  const onKeyDown = (event: KeyboardEvent) => {
    const last = stages.value.length - 1;
    const next = {
      ArrowRight: shown + 1,
      ArrowLeft: shown - 1,
      Home: -1,
      End: last,
    }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const index = Math.min(Math.max(next, -1), last);
    showStage(index);
    list.current?.children[index + 1]?.querySelector<HTMLElement>(".film-card")?.focus();
  };
  return (
    <div class="film-strip">
      <p class="visually-hidden" role="status">
        {doneCount.value} of {stages.value.length} steps done
      </p>
      <ol ref={list} aria-label="Steps of the assembly" onKeyDown={onKeyDown}>
        <li>
          <Card index={-1} title="All parts" picture={thumbnails.value.get(ALL_PARTS)} />
        </li>
        {stages.value.map((stage, index) => (
          <li key={stage.id} class={isDone(stage) ? "done" : ""}>
            <Card index={index} title={stage.title} picture={thumbnails.value.get(stage.id)} />
            <Tick stage={stage} index={index} />
          </li>
        ))}
      </ol>
    </div>
  );
}

interface CardProps {
  index: number;
  title: string;
  picture: string | undefined;
}

function Card({ index, title, picture }: CardProps) {
  const isShown = stageIndex.value === index;
  return (
    <button
      type="button"
      class="film-card"
      aria-current={isShown ? "step" : undefined}
      tabIndex={isShown ? 0 : -1}
      onClick={() => showStage(index)}
    >
      {picture ? <img src={picture} alt="" /> : <span class="film-blank" />}
      <span class="film-title">
        {index >= 0 && <b>{index + 1} </b>}
        {title}
      </span>
    </button>
  );
}

function Tick({ stage, index }: { stage: GuideStage; index: number }) {
  return (
    <input
      type="checkbox"
      class="check film-tick"
      aria-label={`Step ${index + 1} is done: ${stage.title}`}
      checked={isDone(stage)}
      onChange={(event) => void tick(stage, event.currentTarget.checked)}
    />
  );
}
