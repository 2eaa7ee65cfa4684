//! Property tests of orders, trees and fill against plain dense elimination.
use super::*;
use proptest::prelude::*;

/// Small graphs of every density, isolated vertices and several components included.
fn graphs() -> impl Strategy<Value = Graph> {
    (1_usize..60, 0_usize..4).prop_flat_map(|(n, density)| {
        let edge = (0..n as u32, 0..n as u32);
        proptest::collection::vec(edge, 0..n * density + 1)
            .prop_map(move |edges| Graph::from_edges(n, || edges.iter().copied()))
    })
}

/// The structure of L by eliminating vertex after vertex in a dense matrix: `true` on and below the diagonal.
fn dense_factor(graph: &Graph, order: &[u32]) -> Vec<Vec<bool>> {
    let n = graph.n();
    let position = inverse(order);
    let mut matrix = vec![vec![false; n]; n];
    for v in 0..n {
        matrix[v][v] = true;
        for &w in graph.neighbours(order[v]) {
            matrix[position[w as usize] as usize][v] = true;
        }
    }
    for k in 0..n {
        let rows: Vec<usize> = (k + 1..n).filter(|&i| matrix[i][k]).collect();
        for &i in &rows {
            for &j in rows.iter().filter(|&&j| j <= i) {
                matrix[i][j] = true;
            }
        }
    }
    for i in 0..n {
        matrix[i][i + 1..].fill(false);
    }
    matrix
}

fn assert_permutation(order: &[u32], n: usize) {
    let mut sorted = order.to_vec();
    sorted.sort_unstable();
    assert!(sorted.iter().copied().eq(0..n as u32), "not a permutation of 0..{n}: {order:?}");
}

/// The path 0 - 1 - ... - (n - 1) with all edges of length up to `band`.
fn band(n: usize, band: usize) -> Graph {
    Graph::from_edges(n, || {
        (0..n).flat_map(move |i| (i + 1..n.min(i + band + 1)).map(move |j| (i as u32, j as u32)))
    })
}

/// A square grid of side * side vertices, each square cut by the same diagonal: the pattern of a mesh.
fn grid(side: usize) -> Graph {
    let at = move |x: usize, y: usize| (y * side + x) as u32;
    let mut triangles = Vec::new();
    for y in 1..side {
        for x in 1..side {
            triangles.push([at(x - 1, y - 1), at(x, y - 1), at(x, y)]);
            triangles.push([at(x - 1, y - 1), at(x, y), at(x - 1, y)]);
        }
    }
    Graph::from_triangles(side * side, &triangles)
}

/// Graphs that break naive orderings.
fn awkward() -> Vec<(&'static str, Graph)> {
    let star = |n: u32| Graph::from_edges(n as usize, || (1..n).map(|v| (0, v)));
    let complete =
        |n: u32| Graph::from_edges(n as usize, || (0..n).flat_map(move |a| (0..a).map(move |b| (a, b))));
    vec![
        ("empty", Graph::from_edges(0, std::iter::empty)),
        ("one vertex", Graph::from_edges(1, std::iter::empty)),
        ("diagonal", Graph::from_edges(5000, std::iter::empty)),
        ("star", star(3000)),
        ("complete", complete(300)),
        ("pentadiagonal", band(4000, 2)),
        (
            "two grids",
            Graph::from_edges(5000, || {
                (0..2).flat_map(|half| {
                    (0..2499_u32).flat_map(move |v| {
                        let base = half * 2500;
                        [(base + v, base + v + 1), (base + v, base + (v + 50).min(2499))]
                    })
                })
            }),
        ),
    ]
}

proptest! {
    #[test]
    fn fill_agrees_with_dense_elimination(graph in graphs(), seed in any::<u64>()) {
        let mut order: Vec<u32> = (0..graph.n() as u32).collect();
        order.sort_by_key(|&v| (u64::from(v) + 1).wrapping_mul(seed | 1).rotate_left(17));
        let factor = dense_factor(&graph, &order);
        let pattern = Pattern::new(&graph, &order);
        let parent = pattern.elimination_tree();
        let counts = pattern.column_counts(&parent, &postorder(&parent));
        for k in 0..graph.n() {
            let column: Vec<usize> = (k..graph.n()).filter(|&i| factor[i][k]).collect();
            prop_assert_eq!(parent[k], column.get(1).map_or(NONE, |&i| i as u32));
            prop_assert_eq!(counts[k] as usize, column.len());
        }
        let fill = pattern.fill();
        prop_assert_eq!(fill.entries, counts.iter().map(|&c| u64::from(c)).sum::<u64>());
        prop_assert_eq!(fill.flops, counts.iter().map(|&c| u128::from(c).pow(2)).sum::<u128>());
    }

    #[test]
    fn postorder_puts_every_subtree_in_one_piece(graph in graphs()) {
        let order: Vec<u32> = (0..graph.n() as u32).collect();
        let parent = Pattern::new(&graph, &order).elimination_tree();
        let nodes = postorder(&parent);
        assert_permutation(&nodes, graph.n());
        let rank = inverse(&nodes);
        for k in 0..graph.n() {
            let inside = |mut j: u32| loop {
                if j as usize == k { return true; }
                if j == NONE { return false; }
                j = parent[j as usize];
            };
            let subtree: Vec<u32> = (0..graph.n() as u32).filter(|&j| inside(j)).collect();
            let first = rank[k] + 1 - subtree.len() as u32;
            prop_assert!(subtree.iter().all(|&j| (first..=rank[k]).contains(&rank[j as usize])));
        }
    }

    #[test]
    fn minimum_degree_is_a_permutation(graph in graphs()) {
        assert_permutation(&minimum_degree(&graph).order, graph.n());
    }
}

#[test]
fn minimum_degree_fills_nothing_on_trees_and_little_on_grids() {
    // A tree has a perfect elimination order, and minimum degree finds it: leaves first.
    let tree = Graph::from_edges(1000, || (1..1000).map(|v| (v, (v - 1) / 2)));
    assert_eq!(minimum_degree(&tree).fill(&tree).entries, 1999);
    // 31 n log2(n) / 4 is the leading term for nested dissection of a square grid (George 1973).
    let grid = grid(100);
    let natural: Vec<u32> = (0..10_000).collect();
    let entries = minimum_degree(&grid).fill(&grid).entries;
    assert!(entries < 300_000, "{entries}");
    assert!(3 * entries < Pattern::new(&grid, &natural).fill().entries);
}

#[test]
fn awkward_graphs_are_ordered() {
    for (name, graph) in awkward() {
        println!("{name}");
        assert_permutation(&minimum_degree(&graph).order, graph.n());
    }
    // The hub of a star goes last, or everything fills.
    let (_, star) = &awkward()[3];
    assert_eq!(minimum_degree(star).fill(star).entries, 2 * 3000 - 1);
}

/// Every node's range is covered by its children and its own part; no edge joins two children's ranges.
fn assert_tree(graph: &Graph, ordering: &Ordering) {
    let nodes = ordering.tree.nodes();
    let root = ordering.tree.root();
    assert_eq!((root.first, root.end), (0, graph.n() as u32));
    let mut leaf_or_separator = vec![usize::MAX; graph.n()];
    for (t, node) in nodes.iter().enumerate() {
        assert!(node.first <= node.own && node.own <= node.end);
        if let Some([a, b]) = node.children {
            assert!((a as usize) < t && (b as usize) < t);
            let (a, b) = (nodes[a as usize], nodes[b as usize]);
            assert_eq!((a.first, a.end, b.end), (node.first, b.first, node.own));
        } else {
            assert_eq!(node.first, node.own);
        }
        leaf_or_separator[node.own as usize..node.end as usize].fill(t);
    }
    assert!(!leaf_or_separator.contains(&usize::MAX));
    let position = inverse(&ordering.order);
    for v in 0..graph.n() as u32 {
        for &w in graph.neighbours(v) {
            let (low, high) = (position[v as usize], position[w as usize]);
            let above = nodes[leaf_or_separator[low.max(high) as usize]];
            assert!(above.first <= low.min(high), "edge {v} - {w} joins two separated parts");
        }
    }
}

proptest! {
    #[test]
    fn separators_separate(graph in graphs()) {
        let ordering = nested_dissection(&graph);
        assert_permutation(&ordering.order, graph.n());
        assert_tree(&graph, &ordering);
    }
}

#[test]
fn awkward_graphs_are_dissected() {
    for (name, graph) in awkward() {
        println!("{name}");
        let ordering = nested_dissection(&graph);
        assert_permutation(&ordering.order, graph.n());
        assert_tree(&graph, &ordering);
    }
}

#[test]
fn dissection_of_a_grid_is_deep_and_no_worse_than_minimum_degree() {
    let grid = grid(150);
    let ordering = nested_dissection(&grid);
    assert_tree(&grid, &ordering);
    assert!(ordering.tree.nodes().len() > 100);
    let (ours, other) = (ordering.fill(&grid), minimum_degree(&grid).fill(&grid));
    // Minimum degree is at its best on small regular grids; on them the two are close.
    assert!(10 * ours.entries < 11 * other.entries, "{ours:?} {other:?}");
    // The root separator of a square is about one side long.
    let root = ordering.tree.root();
    assert!(root.end - root.own < 200, "{root:?}");
}

#[test]
fn dissection_does_not_depend_on_the_number_of_threads() {
    let grid = grid(120);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool");
        pool.install(|| nested_dissection(&grid))
    };
    let one = with(1);
    for threads in [2, 3, 8] {
        assert_eq!(one, with(threads));
    }
}
