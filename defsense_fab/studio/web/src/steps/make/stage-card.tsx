import { useEffect, useRef } from "preact/hooks";
import type { GuideStage } from "../../protocol/messages";
import { isPhone } from "../../state/layout";
import { inPageWords } from "../../state/page-words";
import { IconButton } from "../../ui/button";
import { Checkbox } from "../../ui/choices";
import { isDone, showStage, stage, stageIndex, stages, tick } from "./state";

/** The instructions of the shown step. */
export function StageCard() {
  const shown = stage.value;
  if (!shown) return null;
  return <Card shown={shown} index={stageIndex.value} />;
}

function Card({ shown, index }: { shown: GuideStage; index: number }) {
  const last = stages.value.length - 1;
  const card = useRef<HTMLElement>(null);
  useEffect(() => {
    const sheet = card.current?.closest(".inspector-content");
    if (!sheet || !card.current || !isPhone.peek()) return;
    sheet.scrollTop += card.current.getBoundingClientRect().top - sheet.getBoundingClientRect().top;
  }, [shown.id]);
  return (
    <section ref={card} class="stage-card" aria-label={`Step ${index + 1} of ${last + 1}`}>
      <header>
        <span class="muted">
          Step {index + 1} of {last + 1}
        </span>
        <IconButton icon="arrowLeft" label="Previous step" shortcut="ArrowLeft" onClick={() => showStage(index - 1)} />
        <IconButton
          icon="arrowRight"
          label="Next step"
          shortcut="ArrowRight"
          disabled={index === last}
          onClick={() => showStage(index + 1)}
        />
        <IconButton icon="close" label="Show all parts and lists" onClick={() => showStage(-1)} />
      </header>
      <h3>{shown.title}</h3>
      {shown.passages.map((lines, k) => (
        <ul key={k}>
          {lines.map((line) => (
            <li key={line}>{inPageWords(line)}</li>
          ))}
        </ul>
      ))}
      <Checkbox label="This step is done" isOn={isDone(shown)} onChange={(isOn) => void tick(shown, isOn)} />
    </section>
  );
}
