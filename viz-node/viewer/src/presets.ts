// Color maps of the field, at equal distances: every 1/8 of the range. Opacities stay those of the points.
// viridis and inferno: Matplotlib (CC0); cool-warm: K. Moreland, "Diverging Color Maps for Scientific Visualization", 2009.

export const PRESETS: Record<string, string[]> = {
  viridis: ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"],
  inferno: ["#000004", "#210c4a", "#57106e", "#8a226a", "#bc3754", "#e45a31", "#f98e09", "#f9cb35", "#fcffa4"],
  "cool-warm": ["#3b4cc0", "#6788ee", "#9abbff", "#c9d7f0", "#dddddd", "#f7bca1", "#ee8468", "#d65244", "#b40426"],
  gray: ["#000000", "#202020", "#404040", "#606060", "#808080", "#a0a0a0", "#c0c0c0", "#e0e0e0", "#ffffff"],
};
