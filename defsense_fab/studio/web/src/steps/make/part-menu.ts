import { hiddenParts, isolate, showAllParts, togglePart } from "./state";

/** The actions for a part. */
export function partMenu(name: string) {
  const isOff = hiddenParts.value.includes(name);
  return [
    {
      id: "hide",
      label: isOff ? "Show" : "Hide",
      icon: isOff ? ("eye" as const) : ("eyeOff" as const),
      run: () => togglePart(name),
    },
    { id: "isolate", label: "Isolate", icon: "part" as const, run: () => isolate(name) },
    { id: "show-all", label: "Show all parts", icon: "eye" as const, run: showAllParts },
  ];
}
