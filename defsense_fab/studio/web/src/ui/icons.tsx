// Icons of 16 px, drawn with one stroke of 1.5 px.
import type { ComponentChildren } from "preact";

const DRAWINGS = {
  arrowLeft: <path d="M13 8H3m4-4L3 8l4 4" />,
  arrowRight: <path d="M3 8h10M9 4l4 4-4 4" />,
  check: <path d="m3 8.5 3.2 3.2L13 4.8" />,
  chevronDown: <path d="m4 6 4 4 4-4" />,
  chevronRight: <path d="m6 4 4 4-4 4" />,
  chevronUp: <path d="m4 10 4-4 4 4" />,
  close: <path d="m4 4 8 8m0-8-8 8" />,
  command: <path d="m3 4 4 4-4 4m6 0h4" />,
  copy: <path d="M6 6h7v7H6zM3.5 10H3V3h7v.5" />,
  cord: <path d="M2 11c3.5 0 3-6 6-6s2.5 6 6 6" />,
  devices: <path d="M2.5 2.5h4.5v4.5H2.5zm6.5 0h4.5v4.5H9zM2.5 9h4.5v4.5H2.5zM9 9h4.5v4.5H9z" />,
  download: <path d="M8 2.5v7.5m-3.2-3L8 10.2 11.2 7M3 13.5h10" />,
  draw: <path d="m3 13 .7-3L10.6 3.1a1.2 1.2 0 0 1 1.7 0l.6.6a1.2 1.2 0 0 1 0 1.7L6 12.3z" />,
  error: <path d="M5.3 2h5.4L14 5.3v5.4L10.7 14H5.3L2 10.7V5.3zM8 5v3.5M8 11v.01" />,
  eye: (
    <>
      <path d="M1.5 8S4 3.5 8 3.5 14.5 8 14.5 8 12 12.5 8 12.5 1.5 8 1.5 8z" />
      <circle cx="8" cy="8" r="1.8" />
    </>
  ),
  eyeOff: (
    <path d="M6.3 3.7A6 6 0 0 1 8 3.5c4 0 6.5 4.5 6.5 4.5a12 12 0 0 1-1.8 2.3M4.2 4.8A11 11 0 0 0 1.5 8S4 12.5 8 12.5a6 6 0 0 0 3.3-1M2.5 2.5l11 11" />
  ),
  file: <path d="M4 2h5l3 3v9H4zm5 0v3h3" />,
  fit: <path d="M2.5 6V2.5H6m4 0h3.5V6m0 4v3.5H10m-4 0H2.5V10" />,
  folder: <path d="M2 4h4l1.5 2H14v7H2z" />,
  idea: <path d="M6 11.5c0-1.5-2-2.2-2-5a4 4 0 0 1 8 0c0 2.8-2 3.5-2 5zm.5 2.5h3" />,
  info: (
    <>
      <circle cx="8" cy="8" r="6" />
      <path d="M8 7.5V11M8 5v.01" />
    </>
  ),
  keyboard: <path d="M1.5 4h13v8h-13zm3 2.5v.01m2.4-.01v.01m2.3-.01v.01m2.3-.01v.01M5 9.5h6" />,
  lock: <path d="M4 7.5h8V13H4zm1.7 0V5.3a2.3 2.3 0 0 1 4.6 0v2.2" />,
  make: <path d="m8 1.8 5.5 3v6.4L8 14.2l-5.5-3V4.8zM2.5 4.8 8 8m0 0 5.5-3.2M8 8v6.2" />,
  measure: <path d="M1.5 8h2.7l2-4.5 3.4 9 2-4.5h2.9" />,
  menu: <path d="M2.5 4.5h11M2.5 8h11M2.5 11.5h11" />,
  minus: <path d="M3 8h10" />,
  mirror: <path d="M8 2v12M5.5 4.5 2 11.5h3.5zm5 0 3.5 7h-3.5z" />,
  monitor: <path d="M2 3h12v8H2zm3.5 10.5h5M8 11v2.5" />,
  moon: <path d="M13 9.5A5.5 5.5 0 0 1 6.5 3a5.5 5.5 0 1 0 6.5 6.5z" />,
  more: <path stroke-width="2.4" d="M3.5 8h.01M8 8h.01M12.5 8h.01" />,
  optimize: <path d="M2.5 2.5v11h11M5 10l2.5-3.5 2 2L13 4" />,
  part: <path d="M3 3h10v10H3z" />,
  pause: <path d="M5.5 3.5v9m5-9v9" />,
  pencil: <path d="m3 13 .7-3L10.6 3.1l2.3 2.3L6 12.3z" />,
  play: <path d="m5 3.2 7.5 4.8L5 12.8z" />,
  plus: <path d="M8 3v10M3 8h10" />,
  pose: <path d="M2.5 13.5h4m-2 0V9c0-3.5 2-5.5 7.5-5.5m-2-2 2 2-2 2" />,
  redo: <path d="M10 3.5 12.8 6.3 10 9.1M12.8 6.3H6.5a3.4 3.4 0 0 0 0 6.8h2" />,
  refresh: <path d="M13 8a5 5 0 1 1-1.7-3.7M13 2v3h-3" />,
  region: <path stroke-dasharray="2 1.8" d="M3 3h10v10H3z" />,
  ruler: <path d="m2 10.5 8.5-8.5 3.5 3.5L5.5 14zm2.5-2.5 1.3 1.3M7 5.5l1.3 1.3" />,
  search: (
    <>
      <circle cx="7" cy="7" r="4.2" />
      <path d="m10.2 10.2 3.5 3.5" />
    </>
  ),
  section: <path d="M2.5 6 8 3l5.5 3L8 9zm0 4L8 13l5.5-3" />,
  select: <path d="m3.5 2.5 9 4.7-4 1.2-1.8 4.1z" />,
  sidebar: <path d="M2 3h12v10H2zm4 0v10" />,
  stop: <path d="M4 4h8v8H4z" />,
  sun: (
    <>
      <circle cx="8" cy="8" r="2.7" />
      <path d="M8 1.5v1.3m0 10.4v1.3M1.5 8h1.3m10.4 0h1.3M3.4 3.4l.9.9m7.4 7.4.9.9m0-9.2-.9.9m-7.4 7.4-.9.9" />
    </>
  ),
  trash: <path d="M2.5 4.5h11M6 4.5v-2h4v2m2 0-.6 9H4.6L4 4.5M6.7 7v4m2.6-4v4" />,
  undo: <path d="M6 3.5 3.2 6.3 6 9.1M3.2 6.3h6.3a3.4 3.4 0 0 1 0 6.8h-2" />,
  unlock: <path d="M4 7.5h8V13H4zm1.7 0V5.3a2.3 2.3 0 0 1 4.4-.9" />,
  upload: <path d="M8 10.5V3m-3.2 3L8 2.8 11.2 6M3 13.5h10" />,
  warning: <path d="M8 2.2 14.3 13H1.7zM8 6.5v3M8 11.2v.01" />,
} satisfies Record<string, ComponentChildren>;

export type IconName = keyof typeof DRAWINGS;

/** An icon; its button or text has the name. */
export function Icon({ name, size = 16 }: { name: IconName; size?: number }) {
  return (
    <svg
      class="icon"
      viewBox="0 0 16 16"
      width={size}
      height={size}
      fill="none"
      stroke="currentColor"
      stroke-width="1.5"
      stroke-linecap="round"
      stroke-linejoin="round"
      aria-hidden="true"
    >
      {DRAWINGS[name]}
    </svg>
  );
}
