//! Fill and time of the two orderings, and of one made elsewhere, on the pattern of a matrix:
//! `cargo run --release -p lapsolve --example ordering -- matrix.mtx [matrix.graph]`
//!
//! With a second path the graph is written there in the format of METIS; where `matrix.graph.iperm` exists (made by
//! `ndmetis matrix.graph`), that order is judged by the same count.
use lapsolve::ordering::{Graph, Pattern, minimum_degree, nested_dissection};
use std::error::Error;
use std::fmt::Write;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args().skip(1);
    let graph = read_matrix_market(&paths.next().ok_or("usage: ordering matrix.mtx [matrix.graph]")?)?;
    println!(
        "{} vertices, {} edges, {} threads",
        graph.n(),
        graph.entries() / 2,
        rayon::current_num_threads()
    );
    for method in [minimum_degree, nested_dissection] {
        let start = Instant::now();
        let ordering = method(&graph);
        report(ordering.name, Some(1e3 * start.elapsed().as_secs_f64()), &graph, &ordering.order);
    }
    if let Some(path) = paths.next() {
        std::fs::write(&path, metis_format(&graph))?;
        match std::fs::read_to_string(format!("{path}.iperm")) {
            Ok(text) => report("ndmetis", None, &graph, &inverse_of_positions(&text, graph.n())?),
            Err(why) => println!("no {path}.iperm ({why}): run ndmetis {path}"),
        }
    }
    Ok(())
}

fn report(name: &str, milliseconds: Option<f64>, graph: &Graph, order: &[u32]) {
    let fill = Pattern::new(graph, order).fill();
    let time = milliseconds.map_or("-".into(), |ms| format!("{ms:.1} ms"));
    println!(
        "{name:18} {time:>10}  nnz(L) {:>10}  flops {:.4e}  height {}",
        fill.entries, fill.flops as f64, fill.height
    );
}

/// The pattern of a coordinate file: 1-based row and column at the start of each line after the size line.
fn read_matrix_market(path: &str) -> Result<Graph, Box<dyn Error>> {
    let text = std::fs::read_to_string(path)?;
    let mut lines = text.lines().filter(|line| !line.starts_with('%') && !line.trim().is_empty());
    let size = lines.next().ok_or("no size line")?;
    let n: usize = size.split_whitespace().next().ok_or("no size")?.parse()?;
    let mut edges = Vec::new();
    for line in lines {
        let mut fields = line.split_whitespace();
        let mut index = || -> Result<u32, Box<dyn Error>> {
            let value: u32 = fields.next().ok_or_else(|| format!("too few fields: {line}"))?.parse()?;
            if (1..=n).contains(&(value as usize)) {
                Ok(value - 1)
            } else {
                Err(format!("not in 1..={n}: {line}").into())
            }
        };
        edges.push((index()?, index()?));
    }
    Ok(Graph::from_edges(n, || edges.iter().copied()))
}

fn metis_format(graph: &Graph) -> String {
    let mut text = format!("{} {}\n", graph.n(), graph.entries() / 2);
    for v in 0..graph.n() as u32 {
        for w in graph.neighbours(v) {
            write!(text, "{} ", w + 1).expect("writing to a string does not fail");
        }
        text.push('\n');
    }
    text
}

/// The order from a file that gives each vertex its elimination position.
fn inverse_of_positions(text: &str, n: usize) -> Result<Vec<u32>, Box<dyn Error>> {
    let positions = text.split_whitespace().map(str::parse::<u32>).collect::<Result<Vec<u32>, _>>()?;
    let mut order = vec![u32::MAX; n];
    for (v, &position) in positions.iter().enumerate() {
        *order.get_mut(position as usize).ok_or("a position is out of range")? = v as u32;
    }
    if positions.len() == n && !order.contains(&u32::MAX) {
        Ok(order)
    } else {
        Err("not a permutation".into())
    }
}
