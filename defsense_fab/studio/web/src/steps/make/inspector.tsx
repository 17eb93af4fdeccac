// The state of the parts, the shown step, and the lists of what to print, cut, buy and check.
import type { Guide, MadeFile } from "../../protocol/messages";
import { inPageWords } from "../../state/page-words";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { BuildBanner } from "./build-banner";
import { GuideList } from "./guide-list";
import { StageCard } from "./stage-card";
import { guide, hidePlace, type Place, place, showPlace, stage } from "./state";

/** Titles of the lists by those of the guide. */
const TITLES: Record<string, string> = {
  Print: "Print list",
  "Bill of materials": "Shopping list",
};

export function MakeInspector() {
  const shown = guide.value;
  return (
    <div class="make-inspector">
      <BuildBanner />
      <StageCard />
      {shown?.id && <Lists shown={shown} isOpen={stage.value === null} />}
    </div>
  );
}

/** A warning as a sentence, without the coordinates of a place that a button shows. */
function noteText(text: string, hasPlace: boolean): string {
  const words = inPageWords(hasPlace ? text.replace(/,? near \([^)]*\),?/, "") : text);
  return words.charAt(0).toUpperCase() + words.slice(1);
}

function PlaceButton({ at, text }: Place) {
  const isShown = place.value?.text === text && place.value.at.join() === at.join();
  return (
    <Button
      variant="quiet"
      icon={isShown ? "eyeOff" : "eye"}
      onClick={() => (isShown ? hidePlace() : showPlace({ at, text }))}
    >
      {isShown ? "Hide the place" : "Show the place"}
    </Button>
  );
}

function Lists({ shown, isOpen }: { shown: Guide; isOpen: boolean }) {
  const { notes, lists, checks, files } = shown;
  const passedAt = checks?.header.indexOf("passed") ?? -1;
  const passed = checks?.rows.filter((row) => row[passedAt] === "yes").length ?? 0;
  const failed = (checks?.rows.length ?? 0) - passed;
  // Those with a place first: something can be looked at there.
  const sorted = [...notes].sort((a, b) => Number(b.point !== null) - Number(a.point !== null));
  const placed = notes.filter(({ point }) => point !== null).length;
  return (
    <div class="make-lists" hidden={!isOpen}>
      {checks && <Verdict failed={failed} placed={placed} others={notes.length - placed} />}
      {notes.length > 0 && (
        <Section title="Warnings" name="make.warnings" aside={notes.length}>
          <ul class="make-notes">
            {sorted.map(({ text, point }) => (
              <li key={text}>
                <p>{noteText(text, point !== null)}</p>
                {point && <PlaceButton at={point} text={noteText(text, true)} />}
              </li>
            ))}
          </ul>
        </Section>
      )}
      {lists.map((list) => (
        <Section
          key={list.title}
          title={TITLES[list.title] ?? list.title}
          name={`make.${list.title}`}
          aside={list.rows.length}
        >
          <GuideList list={list} />
        </Section>
      ))}
      {checks && (
        <Section
          title="Checks"
          name="make.checks"
          isOpenAtFirst={passed < checks.rows.length}
          aside={`${passed} of ${checks.rows.length} passed`}
        >
          <GuideList list={checks} />
        </Section>
      )}
      <Section title="Files" name="make.files" aside={files.length}>
        <ul class="make-files">
          {files.map((file) => (
            <FileLink key={file.path} file={file} />
          ))}
        </ul>
      </Section>
    </div>
  );
}

interface VerdictProps {
  /** Number of checks that failed. */
  failed: number;
  /** Number of warnings with a place, and of the others. */
  placed: number;
  others: number;
}

/** Whether anything has to be done about checks and warnings, in one sentence each. */
function Verdict({ failed, placed, others }: VerdictProps) {
  const [icon, tone] = failed ? (["error", "failed"] as const) : placed ? (["warning", "look"] as const) : (["check", "passed"] as const);
  const verdict = failed
    ? `${failed === 1 ? "1 check" : `${failed} checks`} failed: change the design before you print.`
    : "All checks passed: the parts can be made as they are.";
  const look = placed ? ` Look at ${placed === 1 ? "the place" : `the ${placed} places`} in Warnings before you assemble.` : "";
  const rest = others ? ` ${others === 1 ? "1 other warning is" : `${others} other warnings are`} about what to expect.` : "";
  return (
    <p class={`make-verdict ${tone}`} role="status">
      <Icon name={icon} />
      <span>
        <b>{verdict}</b>
        {look}
        {placed ? rest : rest.replace(" other", "")}
      </span>
    </p>
  );
}

function FileLink({ file: { title, name, path, size } }: { file: MadeFile }) {
  return (
    <li>
      <a href={path} download={name}>
        <Icon name="download" />
        {title}
      </a>
      <span class="muted">
        {name}, {fileSize(size)}
      </span>
    </li>
  );
}

function fileSize(bytes: number): string {
  return bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
