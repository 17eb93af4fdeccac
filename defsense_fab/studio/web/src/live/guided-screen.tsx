// A guided run: the step with its instruction, its keys, pictures, bars and plots.
import { useSignal } from "@preact/signals";
import { Fragment } from "preact";
import { useEffect, useRef } from "preact/hooks";
import type { GuidedKey, GuidedState } from "../protocol/messages";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { Button } from "../ui/button";
import { ProgressBar } from "../ui/feedback";
import { Icon, type IconName } from "../ui/icons";
import { Keys } from "../ui/tooltip";
import { GuidedBarsPart, GuidedPicturePart, GuidedPlotPart } from "./guided-parts";
import "./guided.css";

const DONE_KEY: GuidedKey = { name: "enter", label: "close", action: "start", hint: "" };
const ICONS: Partial<Record<GuidedKey["action"], IconName>> = {
  start: "play",
  complete: "check",
  repeat: "refresh",
  back: "arrowLeft",
  stop: "stop",
};

export const guidedState = connection.event("guided-state");

interface GuidedScreenProps {
  state: GuidedState;
  /** Whether the end waits for a key, as on a page of its own. */
  waitsAtEnd?: boolean;
}

/** The state of a guided run; its keys also work on the keyboard. */
export function GuidedScreen({ state, waitsAtEnd = false }: GuidedScreenProps) {
  const isDone = state.phase === "done";
  const keys = isDone && waitsAtEnd ? [DONE_KEY] : state.keys;
  const press = useKeys(state, keys);
  useBell(state.alerts);
  const pictures = state.parts.filter((part) => part.part === "picture");
  const others = state.parts.filter((part) => part.part !== "picture");
  return (
    <section class={`guided ${state.phase}`} aria-label={state.run}>
      <header class="guided-header">
        <p class="guided-title">{state.title}</p>
        <p class="guided-instruction" role="status">
          <Emphasized text={state.instruction} />
        </p>
        {state.progress !== null && <ProgressBar label="Step" share={state.progress} />}
        {state.status.map((line) => (
          <p key={line} class="guided-status">
            {line}
          </p>
        ))}
      </header>
      {state.notes.length > 0 && (
        <ul class="guided-notes" aria-label="Notes">
          {state.notes.map((note) => (
            <li key={note}>
              <Icon name="warning" /> <span>{note}</span>
            </li>
          ))}
        </ul>
      )}
      <KeyBar keys={keys} press={press} />
      {pictures.length > 0 && (
        <div class="guided-pictures">
          {pictures.map((part) => (
            <GuidedPicturePart key={part.name} picture={part} />
          ))}
        </div>
      )}
      <div class="guided-parts">
        {others.map((part, k) =>
          part.part === "plot" ? (
            <GuidedPlotPart key={`plot-${k}`} plot={part} />
          ) : part.part === "bars" ? (
            <GuidedBarsPart key={`bars-${k}`} bars={part} />
          ) : null,
        )}
      </div>
    </section>
  );
}

function KeyBar({ keys, press }: { keys: readonly GuidedKey[]; press: (key: string) => void }) {
  const shown = keys.filter(({ label }) => label);
  const main = shown.find(({ action }) => action === "start" || action === "complete");
  return (
    <div class="guided-keys" role="toolbar" aria-label="Keys of the step">
      {shown.map((key) => (
        <Button
          key={key.name}
          variant={key === main ? "primary" : "plain"}
          icon={ICONS[key.action]}
          hint={key.hint || undefined}
          onClick={() => press(key.name)}
        >
          {capitalized(key.label)}{" "}
          <Keys shortcut={key.name === "enter" ? "Enter" : key.name.toUpperCase()} />
        </Button>
      ))}
    </div>
  );
}

/** Press keys of the shown step, once until the state changes. */
function useKeys(state: GuidedState, keys: readonly GuidedKey[]): (key: string) => void {
  const pressed = useSignal("");
  const now = useRef({ state, keys });
  now.current = { state, keys };
  const press = (key: string) => {
    const { step, phase, done } = now.current.state;
    const at = `${key} ${step} ${phase} ${done.length}`;
    if (pressed.value === at && key !== "r") return;
    pressed.value = at;
    setTimeout(() => (pressed.value = ""), 700);
    void run(connection.send("press-key", { key, step, phase }));
  };
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      const target = event.target as Element | null;
      if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
      if (target?.matches?.("input, select, textarea")) return;
      const name = event.key === "Enter" ? "enter" : event.key.toLowerCase();
      if (name === "enter" && target?.matches?.("button, a[href], summary")) return;
      if (!now.current.keys.some((key) => key.name === name)) return;
      event.preventDefault();
      press(name);
    };
    document.addEventListener("keydown", onKey);
    return () => document.removeEventListener("keydown", onKey);
  }, []);
  return press;
}

/** A short tone when something has just been completed. */
function useBell(alerts: number): void {
  const heard = useRef(alerts);
  useEffect(() => {
    if (alerts > heard.current) ring();
    heard.current = alerts;
  }, [alerts]);
}

function ring(): void {
  const audio = new AudioContext();
  const tone = audio.createOscillator();
  const volume = audio.createGain();
  volume.gain.setValueAtTime(0.08, audio.currentTime);
  volume.gain.exponentialRampToValueAtTime(0.001, audio.currentTime + 0.25);
  tone.frequency.value = 880;
  tone.connect(volume).connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + 0.25);
  tone.onended = () => void audio.close();
}

function Emphasized({ text }: { text: string }) {
  return (
    <>
      {text.split("**").map((words, k) =>
        k % 2 ? <strong key={k}>{words}</strong> : <Fragment key={k}>{words}</Fragment>,
      )}
    </>
  );
}

function capitalized(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
