//! Blocks that move: lines in their coordinates, arcs, canned cycles, probing.

mod arcs;
mod coordinates;
mod cycles;
mod probing;
