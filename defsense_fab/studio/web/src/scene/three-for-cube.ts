// three.js as the package of the view cube imports it, which still uses a clock that three.js has
// replaced and warns of. The cube is not animated, so that its clock is started and never read.
export * from "three";

export class Clock {
  start(): void {}

  getDelta(): number {
    return 0;
  }
}
