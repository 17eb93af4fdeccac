// The order in which the parts of the scene are drawn, so that cords shine through the body.
//
// Visible cords come first. The body covers them and marks in the stencil where it does. There the
// depth is cleared, and the cords are drawn again, paler, with the right order among themselves.
export const ORDER = {
  shadow: -2,
  cords: -1,
  bodyDepth: 0,
  body: 1,
  // The following are transparent, so that three draws them after all others.
  transparentBody: 2,
  edges: 3,
  clearDepth: 4,
  outlines: 5,
  hiddenCords: 6,
  grid: 7,
} as const;
