//! Pictures of a block of ticks from a camera that rests, one tick in every drawn frame.

mod probe;
mod sequence;
