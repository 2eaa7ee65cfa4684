//! Fill-reducing elimination orders for sparse Cholesky factorisation.
//!
//! [`minimum_degree()`] is cheap and good for small or long graphs; [`nested_dissection()`] fills less on surfaces and
//! gives the tree of independent subtrees that a parallel factorisation and a parallel solve need. Both look at the
//! graph alone: positions are not needed. [`Pattern`] says what an order costs before any number is factored.
mod bisect;
mod coarsen;
mod dissect;
mod fill;
mod graph;
mod leaf;
mod minimum_degree;
mod refine;
#[cfg(test)]
mod tests;
mod tree;

pub use dissect::nested_dissection;
pub use fill::{Fill, NONE, Pattern, inverse, postorder};
pub use graph::Graph;
pub use tree::{DissectionTree, TreeNode};

/// An elimination order with the tree of independent parts it was made from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ordering {
    /// `order[k]` is the vertex (matrix row) eliminated k-th; a permutation of `0..n`.
    pub order: Vec<u32>,
    /// The parts: every node owns a range of elimination positions.
    pub tree: DissectionTree,
    /// Name of the method, for reports.
    pub name: &'static str,
}

impl Ordering {
    /// Entries, flops and height of the factor of `graph` in this order. Cost: nearly O(n + |E|).
    pub fn fill(&self, graph: &Graph) -> Fill {
        Pattern::new(graph, &self.order).fill()
    }
}

/// Approximate minimum degree on the whole graph; the tree is one leaf.
///
/// Cost: nearly O(n + |E|) on mesh graphs. One thread.
pub fn minimum_degree(graph: &Graph) -> Ordering {
    Ordering {
        order: minimum_degree::minimum_degree_order(graph),
        tree: DissectionTree::leaf(graph.n() as u32),
        name: "minimum-degree",
    }
}
