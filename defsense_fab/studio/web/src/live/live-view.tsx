// The live view: the moving device over the whole window, with its signals and controls.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { LiveDevice } from "../protocol/messages";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { showToast } from "../state/toasts";
import { Button, IconButton } from "../ui/button";
import { BendControls } from "./bend-controls";
import { ControlList } from "./control-list";
import "./live.css";
import { LiveScene } from "./live-scene";
import { isTruthShown, liveDevice, liveNotes, shownFrame, useFrames } from "./live-state";
import { QualityBadge } from "./quality-badge";
import { RestMessage, takeRest } from "./rest-message";
import { SignalHistory, SignalPlot } from "./signal-plot";

interface LiveViewProps {
  /** What the run does before there is a device; also shown beside the name. */
  status?: string;
  /** Returns to where the view was opened from, while the run continues. */
  onClose?: () => void;
  /** Ends the run. */
  onStop?: () => void;
}

/** Keys: T takes the present readings as those at rest, R records an animation, F fits the view. */
export function LiveView({ status = "", onClose, onStop }: LiveViewProps) {
  const device = liveDevice.value;
  const host = useRef<HTMLDivElement>(null);
  const scene = useRef<LiveScene | null>(null);
  const history = useMemo(() => new SignalHistory(), [device?.name]);
  const current = useRef(history);
  current.current = history;

  useEffect(() => {
    const made = new LiveScene(host.current!);
    scene.current = made;
    const stopDevice = liveDevice.subscribe((value) => value?.name && made.setDevice(value));
    const stopRest = connection.onArrays("live-device", (message) => made.setRest(message));
    return () => {
      stopDevice();
      stopRest();
      made.dispose();
      scene.current = null;
    };
  }, []);
  useFrames((frame) => {
    current.current.add(frame);
    scene.current?.show(frame);
  });
  useLiveKeys(() => scene.current?.fit());

  const isRunning = Boolean(device?.name);
  return (
    <section class="live-view" aria-label="Live view">
      <header class="live-bar">
        {onClose && <IconButton icon="arrowLeft" label="Back to Measure" onClick={onClose} />}
        <h1>{device?.name || "Live"}</h1>
        {isRunning && <QualityBadge facts={shownFrame.value?.facts ?? null} />}
        <span class="live-status">{isRunning ? qualityText() : ""}</span>
        <div class="live-actions">
          <IconButton
            icon="fit"
            label="Fit the view"
            shortcut="F"
            onClick={() => scene.current?.fit()}
          />
          <LiveActions device={device} />
          {onStop && (
            <Button icon="stop" onClick={onStop}>
              Stop
            </Button>
          )}
        </div>
      </header>
      <div class="live-stage">
        <div ref={host} class="live-scene" />
        <RestMessage />
        {isRunning ? (
          <CordLegend />
        ) : (
          !connection.isLost.value && (
            <p class="live-preparing" role="status">
              <span class="spinner" aria-hidden="true" /> {status || "Waiting for the device"}
            </p>
          )
        )}
      </div>
      <aside class="live-side" aria-label="Values" tabIndex={0}>
        {isRunning && (
          <>
            {device!.poses.length > 0 && <BendControls poses={device!.poses} />}
            <h3>Controls</h3>
            <ControlList facts={shownFrame.value?.facts ?? null} />
            <Numbers />
            <SignalPlot history={history} channels={device!.channels} />
            <Notes />
          </>
        )}
      </aside>
    </section>
  );
}

function LiveActions({ device }: { device: LiveDevice | null }) {
  const isBusy = useSignal(false);
  const isRecording = liveNotes.value?.isRecording ?? false;
  return (
    <>
      {device?.canTakeRest && (
        <Button
          icon="check"
          hint="Take the present readings as those of the device at rest"
          shortcut="T"
          onClick={() => void takeRest()}
        >
          At rest now
        </Button>
      )}
      {device?.canRecord && (
        <Button
          icon={isRecording ? "stop" : "play"}
          hint="Record the moving surface as an animation file"
          shortcut="R"
          isBusy={isBusy.value}
          aria-pressed={isRecording}
          onClick={() => {
            isBusy.value = true;
            void recordAnimation(!isRecording).finally(() => (isBusy.value = false));
          }}
        >
          {isRecording ? "Stop and save" : "Record animation"}
        </Button>
      )}
    </>
  );
}

function Numbers() {
  const facts = shownFrame.value?.facts;
  const rows: [string, string][] = [];
  if (facts?.markerRadius != null) {
    rows.push(["Markers, 90 %", `± ${facts.markerRadius.toFixed(1)} mm`]);
  }
  if (facts?.trackingError != null) {
    rows.push(["Distance from cameras", `${facts.trackingError.toFixed(1)} mm`]);
  }
  return (
    <dl class="live-numbers">
      {rows.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

function Notes() {
  const { notes = [], latency = "" } = liveNotes.value ?? {};
  return (
    <div class="live-notes">
      {latency && <p>{latency}</p>}
      <ul aria-live="polite">
        {notes.map((note) => (
          <li key={note}>{note}</li>
        ))}
      </ul>
    </div>
  );
}

function CordLegend() {
  return (
    <div class="live-legend" aria-label="Colors">
      <span>Shorter</span>
      <i class="cord-scale" />
      <span>longer</span>
      <span class="marker-words">Sure</span>
      <i class="marker-scale" />
      <span>unsure marker</span>
      {isTruthShown.value && shownFrame.value?.trueVertices && (
        <>
          <i class="true-scale" />
          <span>true shape</span>
        </>
      )}
    </div>
  );
}

function qualityText(): string {
  return shownFrame.value?.facts.qualityText ?? "";
}

async function recordAnimation(isOn: boolean): Promise<void> {
  const answer = await run(connection.send("record-animation", { isOn }));
  if (answer) showToast(answer.text);
}

function useLiveKeys(fit: () => void): void {
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      const isTyping = (event.target as Element | null)?.matches?.("input, select, textarea");
      if (isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
      const key = event.key.toLowerCase();
      if (key === "t" && liveDevice.value?.canTakeRest) void takeRest();
      else if (key === "r" && liveDevice.value?.canRecord) {
        void recordAnimation(!liveNotes.value?.isRecording);
      } else if (key === "f") fit();
    };
    document.addEventListener("keydown", onKey);
    return () => document.removeEventListener("keydown", onKey);
  }, []);
}
