// The order in which the parts of the scene are drawn, so that cords shine through the body.
//
// Visible cords come first. The body covers them and marks in the stencil where it does. There
// the cords are drawn again, paler, in front of the body.
export const ORDER = {
  background: -3,
  cords: -1,
  bodyDepth: 0,
  body: 1,
  // The following are transparent, so that three draws them after all others.
  shadow: 2,
  transparentBody: 3,
  edges: 4,
  hiddenCords: 5,
  outlines: 6,
  chosenCords: 7,
  grid: 8,
} as const;
