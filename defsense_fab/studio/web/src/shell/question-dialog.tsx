// The question whether the script of a body may run, with all code that would run.
import { Fragment } from "preact";
import type { ScriptFile } from "../protocol/messages";
import { connection, question } from "../state/connection";
import { run } from "../state/run";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";

// Characters that change how a text reads without being seen: controls, formats such as those of
// the writing direction, variation selectors, fillers, and spaces other than the usual one.
const UNSEEN =
  /[\p{C}\p{Zl}\p{Zp}\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\uffa0\ufe00-\ufe0f\u{e0100}-\u{e01ef}]|(?! )\p{Zs}/gu;
const USUAL = /^(?:[\n\t]|\r(?=\n))/;

/** A text in pieces; each character that is not seen is a piece of its own, as \uXXXX. */
function revealUnseen(text: string): { text: string; isUnseen: boolean }[] {
  const pieces: { text: string; isUnseen: boolean }[] = [];
  let end = 0;
  for (const match of text.matchAll(UNSEEN)) {
    const [character] = match;
    if (USUAL.test(text.slice(match.index, match.index + 2))) continue;
    if (match.index > end) pieces.push({ text: text.slice(end, match.index), isUnseen: false });
    const code = character.codePointAt(0)!.toString(16).toUpperCase().padStart(4, "0");
    pieces.push({ text: code.length > 4 ? `\\u{${code}}` : `\\u${code}`, isUnseen: true });
    end = match.index + character.length;
  }
  if (end < text.length) pieces.push({ text: text.slice(end), isUnseen: false });
  return pieces;
}

export function QuestionDialog() {
  const pending = question.value;
  if (!pending?.path) return null;
  const answer = (isAllowed: boolean) => void run(connection.send("answer", { run: isAllowed }));
  const isPlural = pending.files.length > 1;
  return (
    <Dialog
      title="Run the script of this device?"
      size="large"
      onClose={() => answer(false)}
      actions={
        <>
          <Button variant="danger" onClick={() => answer(true)}>
            Run it: I know where it comes from
          </Button>
          <Button variant="primary" autofocus onClick={() => answer(false)}>
            Do not run it
          </Button>
        </>
      }
    >
      <p>
        The body is made by{" "}
        <code>
          <Revealed text={pending.path} />
        </code>
        . A script can read, change and send all your files. Run it only if you know who wrote it.
        {isPlural && ` It would run the code of these ${pending.files.length} files:`}
      </p>
      {pending.files.map((file) => (
        <Script key={file.name} file={file} />
      ))}
    </Dialog>
  );
}

function Script({ file: { name, text, size } }: { file: ScriptFile }) {
  const count = revealUnseen(text).filter(({ isUnseen }) => isUnseen).length;
  return (
    <figure class="script">
      <figcaption>
        <code>
          <Revealed text={name} />
        </code>
        <span>{size.toLocaleString("en")} bytes</span>
        {count > 0 && (
          <span class="script-warning">{count} hidden characters, shown as \uXXXX</span>
        )}
      </figcaption>
      {text || size === 0 ? (
        <pre tabIndex={0} aria-label={`Code of ${name}`}>
          <Revealed text={text} />
        </pre>
      ) : (
        <p class="script-machine">Machine code, which cannot be shown.</p>
      )}
    </figure>
  );
}

function Revealed({ text }: { text: string }) {
  return (
    <>
      {revealUnseen(text).map((piece, index) =>
        piece.isUnseen ? (
          <mark key={index}>{piece.text}</mark>
        ) : (
          <Fragment key={index}>{piece.text}</Fragment>
        ),
      )}
    </>
  );
}
