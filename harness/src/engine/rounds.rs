//! Drives the cells of one task: all are prepared, then measured in rounds, one after the other, never two at once.
//!
//! Rounds make slow drift of the machine hit all cells alike; the order within a round is shuffled, so that no cell always
//! follows the same one.

use super::cell::Running;
use super::settings::Settings;
use crate::process;
use crate::record::result::Cell;
use crate::statistics::random::Random;
use std::collections::VecDeque;

/// What a run hears about its cells.
pub trait Observer {
    /// The cell's row has changed; `doing` says what comes next.
    fn row(&mut self, row: Cell, doing: &str);
}

/// Measures `cells`. Where memory does not hold all of them at once, they are taken in several batches.
pub fn measure(cells: Vec<Running<'_>>, settings: &Settings, observer: &mut dyn Observer) {
    let mut random = Random::new(settings.seed);
    let mut waiting: VecDeque<Running<'_>> = cells.into();
    while !waiting.is_empty() {
        let mut live = prepare(&mut waiting, observer);
        set_up_again(&mut live, &mut random, observer);
        for round in 1..=settings.rounds {
            random.shuffle(&mut live);
            for cell in live.iter_mut().filter(|cell| cell.is_live()) {
                cell.round();
                cell.measure_bandwidth();
                observer.row(cell.row(), &format!("round {round} of {}", settings.rounds));
            }
        }
        for cell in live.iter_mut().filter(|cell| cell.is_live()) {
            observer.row(cell.row(), "updates and open-loop frames");
            cell.wind_up();
        }
        columns(&mut live, settings, &mut random, observer);
        for mut cell in live {
            cell.finish();
            observer.row(cell.row(), "done");
        }
    }
}

/// Further fresh processes, one at a time, for set-up and memory.
fn set_up_again(live: &mut [Running<'_>], random: &mut Random, observer: &mut dyn Observer) {
    while live.iter().any(Running::wants_another_set_up) {
        random.shuffle(live);
        for cell in live.iter_mut().filter(|cell| cell.wants_another_set_up()) {
            observer.row(cell.row(), "set-up in another process");
            cell.set_up_again();
        }
    }
}

/// Solves with other numbers of columns: for each number all cells in turn.
fn columns(live: &mut [Running<'_>], settings: &Settings, random: &mut Random, observer: &mut dyn Observer) {
    for cell in live.iter_mut().filter(|cell| cell.is_live()) {
        observer.row(cell.row(), "other numbers of columns");
        cell.prepare_columns();
    }
    for &k in &settings.columns {
        random.shuffle(live);
        for cell in live.iter_mut() {
            cell.columns(k);
        }
    }
}

/// Prepares cells from the front of the queue until memory is short; those that fail are finished at once.
fn prepare<'a>(waiting: &mut VecDeque<Running<'a>>, observer: &mut dyn Observer) -> Vec<Running<'a>> {
    let mut live: Vec<Running<'a>> = Vec::new();
    while let Some(mut cell) = waiting.pop_front() {
        if !live.is_empty() && !has_room(&live) {
            waiting.push_front(cell);
            break;
        }
        observer.row(cell.row(), "preparing");
        cell.begin();
        if cell.is_live() {
            observer.row(cell.row(), "prepared");
            live.push(cell);
        } else {
            cell.finish();
            observer.row(cell.row(), "done");
        }
    }
    live
}

/// Whether another cell as large as the largest so far fits twice over into the memory that is available.
fn has_room(live: &[Running<'_>]) -> bool {
    let largest = live.iter().filter_map(Running::peak_bytes).max().unwrap_or(0);
    process::available_bytes().is_none_or(|available| available > 2 * largest)
}
