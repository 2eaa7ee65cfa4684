//! `animate`: the papers' pipelines from end to end.

mod frames;
mod keep_volume;
mod outputs;
mod plot;
mod retarget;
mod skeleton;
mod solver;
mod statistics;
mod stiff;
mod template;
mod transfer;

use super::{Context, Outcome};
use clap::Subcommand;

/// Move a mesh: by the motion of another one, or by a captured skeleton
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    pipeline: Pipeline,
}

#[derive(Debug, Subcommand)]
enum Pipeline {
    Transfer(Box<transfer::Args>),
    Retarget(Box<retarget::Args>),
}

/// Runs the pipeline.
///
/// # Errors
/// What cannot be read, does not fit, cannot be solved or written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    match &args.pipeline {
        Pipeline::Transfer(args) => transfer::run(args, context),
        Pipeline::Retarget(args) => retarget::run(args, context),
    }
}
