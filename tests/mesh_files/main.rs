//! Mesh files: real ones against published figures, written ones read back, bad ones against declared outcomes.

mod real;
mod round_trip;
