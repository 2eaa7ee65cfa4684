//! The tree of a nested dissection: which ranges of elimination positions are independent of each other.

/// One part of a dissection: a leaf, or a separator with the two parts it separates.
///
/// The elimination positions of the whole part are `first..end`. They begin with those of the children, the first
/// child's before the second's, and end with the node's own, `own..end`: the separator, or everything of a leaf.
/// No entry of L joins the two children's ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TreeNode {
    /// First position of the part.
    pub first: u32,
    /// First position of the node's own vertices.
    pub own: u32,
    /// One past the last position of the part and of the node's own vertices.
    pub end: u32,
    /// Indices of the two children in [`DissectionTree::nodes`]; both smaller than the node's own index.
    pub children: Option<[u32; 2]>,
}

/// The parts of a dissection, children before parents; the last node is the root and covers all positions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DissectionTree {
    nodes: Vec<TreeNode>,
}

impl DissectionTree {
    /// The tree of an order without separators: one leaf with all n positions.
    pub fn leaf(n: u32) -> Self {
        Self { nodes: vec![TreeNode { first: 0, own: 0, end: n, children: None }] }
    }

    /// Takes nodes with children before parents, the root last.
    pub(super) fn from_postorder(nodes: Vec<TreeNode>) -> Self {
        Self { nodes }
    }

    /// All nodes, children before parents.
    pub fn nodes(&self) -> &[TreeNode] {
        &self.nodes
    }

    /// The root: the part that holds everything.
    pub fn root(&self) -> TreeNode {
        *self.nodes.last().expect("a dissection tree has at least one node")
    }
}
