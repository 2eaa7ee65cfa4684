//! Approximate minimum degree on the quotient graph.
//!
//! Method: P. R. Amestoy, T. A. Davis and I. S. Duff, "An approximate minimum degree ordering algorithm", SIAM J.
//! Matrix Anal. Appl. 17 (1996). An eliminated vertex becomes an *element*, whose list holds the clique its
//! elimination made; a live vertex is a *variable*, whose list holds first elements, then variables. Indistinguishable
//! variables (same lists) are merged, variables that would fill nothing leave with the pivot (mass elimination), and
//! an element inside the new one is absorbed even where no edge says so (aggressive absorption).
use super::{Graph, fill::NONE};

/// A vertex with more than this many neighbours times sqrt(n) is eliminated last, as Amestoy, Davis and Duff advise:
/// it would touch nearly every element and turn linear time into quadratic.
const DENSE_FACTOR: f64 = 10.0;
/// No vertex with at most this many neighbours counts as dense: small graphs gain nothing from the rule.
const DENSE_LEAST: usize = 16;

/// Whether a vertex of this degree is set aside and eliminated last.
pub(super) fn is_dense(degree: usize, n: usize) -> bool {
    degree > DENSE_LEAST && degree as f64 > DENSE_FACTOR * (n as f64).sqrt()
}

/// An elimination order of `graph` by approximate minimum degree: entry k is the vertex eliminated k-th.
///
/// Ties go to the vertex whose degree changed last. Cost: nearly O(n + |E|) on mesh graphs, O(n |E|) at worst.
pub fn minimum_degree_order(graph: &Graph) -> Vec<u32> {
    let mut quotient = Quotient::new(graph);
    while quotient.eliminated < quotient.sparse_vertices {
        let pivot = quotient.lowest.take_lowest();
        quotient.eliminate(pivot);
    }
    quotient.order(graph)
}

/// Variables by approximate degree: doubly linked lists, the latest in front.
struct DegreeLists {
    head: Vec<u32>,
    next: Vec<u32>,
    previous: Vec<u32>,
    lowest: usize,
}

impl DegreeLists {
    fn new(n: usize) -> Self {
        Self { head: vec![NONE; n + 1], next: vec![NONE; n], previous: vec![NONE; n], lowest: 0 }
    }

    fn insert(&mut self, v: u32, degree: usize) {
        let front = std::mem::replace(&mut self.head[degree], v);
        if front != NONE {
            self.previous[front as usize] = v;
        }
        self.next[v as usize] = front;
        self.previous[v as usize] = NONE;
        self.lowest = self.lowest.min(degree);
    }

    fn remove(&mut self, v: u32, degree: usize) {
        let (previous, next) = (self.previous[v as usize], self.next[v as usize]);
        if next != NONE {
            self.previous[next as usize] = previous;
        }
        if previous == NONE {
            self.head[degree] = next;
        } else {
            self.next[previous as usize] = next;
        }
    }

    fn take_lowest(&mut self) -> u32 {
        while self.head[self.lowest] == NONE {
            self.lowest += 1;
        }
        let v = self.head[self.lowest];
        self.remove(v, self.lowest);
        v
    }
}

/// The quotient graph. Variables and elements share one numbering: an element bears the name of its pivot.
struct Quotient {
    /// All lists; variable or element i owns `lists[start[i]..start[i] + length[i]]`.
    lists: Vec<u32>,
    start: Vec<u32>,
    length: Vec<u32>,
    /// Per variable, how many entries at the front of its list are elements.
    elements: Vec<u32>,
    /// Vertices a variable stands for; 0 once it is merged or eliminated, negative while it is in the new element.
    weight: Vec<i32>,
    /// Variables: upper bound of the vertices outside that they touch. Elements: weight of their list.
    degree: Vec<u32>,
    /// Elements: 0 when absorbed; at least `tag`: `tag` plus the weight of their list outside the new element.
    /// Variables and elements while lists are compared: equal to `tag` where seen.
    stamp: Vec<u32>,
    tag: u32,
    lowest: DegreeLists,
    /// Heads of the chains of variables with equal hash; the chains use `chain`.
    bucket: Vec<u32>,
    chain: Vec<u32>,
    hash: Vec<u32>,
    /// Vertices merged into i, as a linked list that starts at i, and its last member.
    member: Vec<u32>,
    last_member: Vec<u32>,
    pivots: Vec<u32>,
    eliminated: usize,
    /// Vertices that are not set aside as dense.
    sparse_vertices: usize,
}

impl Quotient {
    fn new(graph: &Graph) -> Self {
        let n = graph.n();
        let entries = graph.entries();
        let mut lists = Vec::with_capacity(entries + entries / 4 + n);
        lists.extend_from_slice(graph.lists());
        let all = |value: u32| vec![value; n];
        let mut quotient = Self {
            lists,
            start: graph.starts()[..n].to_vec(),
            length: (0..n as u32).map(|v| graph.degree(v) as u32).collect(),
            elements: all(0),
            weight: vec![1; n],
            degree: (0..n as u32).map(|v| graph.degree(v) as u32).collect(),
            stamp: all(1),
            tag: 2,
            lowest: DegreeLists::new(n),
            bucket: all(NONE),
            chain: all(NONE),
            hash: all(0),
            member: all(NONE),
            last_member: (0..n as u32).collect(),
            pivots: Vec::with_capacity(n),
            eliminated: 0,
            sparse_vertices: n,
        };
        for v in (0..n).rev() {
            if is_dense(graph.degree(v as u32), n) {
                quotient.weight[v] = 0; // invisible to every scan
                quotient.sparse_vertices -= 1;
            } else {
                quotient.lowest.insert(v as u32, graph.degree(v as u32));
            }
        }
        quotient
    }

    /// One step: the pivot becomes an element, and every variable it touches is updated.
    fn eliminate(&mut self, pivot: u32) {
        let p = pivot as usize;
        self.pivots.push(pivot);
        let own = self.weight[p];
        self.weight[p] = -own;
        let touched = self.form_element(pivot);
        self.next_tag();
        let largest = self.measure_elements(touched.clone());
        let mut gone = own; // weight that leaves with the pivot
        for at in touched.clone() {
            gone += self.update_variable(pivot, self.lists[at]);
        }
        self.tag += largest; // not below any stamp given in this step
        self.merge_indistinguishable(touched.clone());
        self.eliminated += gone as usize;
        self.weight[p] = 0;
        self.finish_element(pivot, touched);
    }

    /// Collects the variables the pivot touches into its own list, marks them by negative weights and takes them out
    /// of the degree lists. Sets `degree[pivot]` to their weight. Absorbs the pivot's elements.
    fn form_element(&mut self, pivot: u32) -> std::ops::Range<usize> {
        let p = pivot as usize;
        self.make_room();
        let (own, elements) = (self.start[p] as usize, self.elements[p] as usize);
        let first = self.lists.len();
        let mut total = 0;
        for at in own..own + elements {
            let e = self.lists[at] as usize;
            if self.stamp[e] != 0 {
                total += self.take_variables(self.start[e] as usize, self.length[e] as usize);
                self.stamp[e] = 0;
                self.length[e] = 0;
            }
        }
        total += self.take_variables(own + elements, self.length[p] as usize - elements);
        let mut range = first..self.lists.len();
        if elements == 0 {
            // Nothing but the own list was read, so the element fits where that list lies.
            self.lists.copy_within(range.clone(), own);
            self.lists.truncate(first);
            range = own..own + range.len();
        }
        self.start[p] = range.start as u32;
        self.length[p] = range.len() as u32;
        self.elements[p] = 0;
        self.degree[p] = total;
        self.stamp[p] = 1;
        range
    }

    /// Appends the live, unmarked variables of a stretch of the lists and marks them; returns their weight.
    fn take_variables(&mut self, from: usize, count: usize) -> u32 {
        let mut total = 0;
        for at in from..from + count {
            let i = self.lists[at];
            let weight = self.weight[i as usize];
            if weight > 0 {
                self.weight[i as usize] = -weight;
                total += weight as u32;
                self.lists.push(i);
                self.lowest.remove(i, self.degree[i as usize] as usize);
            }
        }
        total
    }

    /// Moves the live lists together if the next element might not fit the allocation.
    fn make_room(&mut self) {
        let n = self.start.len();
        if self.lists.capacity() - self.lists.len() >= n {
            return;
        }
        let mut live: Vec<u32> = (0..n as u32)
            .filter(|&i| self.length[i as usize] > 0 && (self.weight[i as usize] != 0 || self.is_element(i)))
            .collect();
        live.sort_unstable_by_key(|&i| self.start[i as usize]);
        let mut end = 0;
        for i in live {
            let (from, count) = (self.start[i as usize] as usize, self.length[i as usize] as usize);
            self.lists.copy_within(from..from + count, end);
            self.start[i as usize] = end as u32;
            end += count;
        }
        self.lists.truncate(end);
    }

    /// Whether i is a live element (only meaningful between two steps).
    fn is_element(&self, i: u32) -> bool {
        self.weight[i as usize] == 0 && self.stamp[i as usize] != 0 && self.elements[i as usize] == NONE
    }

    /// A tag above every stamp; all stamps are reset before it could overflow.
    fn next_tag(&mut self) {
        let n = self.start.len() as u32;
        self.tag += 1;
        if self.tag > u32::MAX - 4 * n.min(u32::MAX / 8) {
            for stamp in &mut self.stamp {
                *stamp = (*stamp).min(1);
            }
            self.tag = 2;
        }
    }

    /// For every element e that shares a variable with the new one: stamp = tag + weight of e outside the new one.
    /// Returns the largest weight of those elements.
    fn measure_elements(&mut self, touched: std::ops::Range<usize>) -> u32 {
        let mut largest = 0;
        for at in touched {
            let i = self.lists[at] as usize;
            let weight = self.weight[i].unsigned_abs();
            let from = self.start[i] as usize;
            for &e in &self.lists[from..from + self.elements[i] as usize] {
                let stamp = &mut self.stamp[e as usize];
                if *stamp >= self.tag {
                    *stamp -= weight;
                } else if *stamp != 0 {
                    largest = largest.max(self.degree[e as usize]);
                    *stamp = self.degree[e as usize] + self.tag - weight;
                }
            }
        }
        largest
    }

    /// Rewrites the list of a touched variable (dead entries out, the new element in front), bounds its degree
    /// outside the new element and files it under its hash. Returns its weight if it leaves with the pivot.
    fn update_variable(&mut self, pivot: u32, variable: u32) -> i32 {
        let i = variable as usize;
        let from = self.start[i] as usize;
        let (elements_end, end) = (from + self.elements[i] as usize, from + self.length[i] as usize);
        let (mut to, mut outside, mut hash) = (from, 0, pivot);
        for at in from..elements_end {
            let e = self.lists[at];
            let stamp = self.stamp[e as usize];
            if stamp > self.tag {
                outside += stamp - self.tag;
                hash = hash.wrapping_add(e);
                self.lists[to] = e;
                to += 1;
            } else {
                self.stamp[e as usize] = 0; // inside the new element
            }
        }
        let variables = to;
        for at in elements_end..end {
            let j = self.lists[at];
            if self.weight[j as usize] > 0 {
                outside += self.weight[j as usize] as u32;
                hash = hash.wrapping_add(j);
                self.lists[to] = j;
                to += 1;
            }
        }
        if outside == 0 {
            return self.mass_eliminate(pivot, variable);
        }
        // The pivot, or an element it absorbed, has just left this list: there is room for one entry.
        self.lists[to] = self.lists[variables];
        self.lists[variables] = self.lists[from];
        self.lists[from] = pivot;
        self.elements[i] = (variables - from + 1) as u32;
        self.length[i] = (to - from + 1) as u32;
        self.degree[i] = self.degree[i].min(outside);
        self.hash[i] = hash % self.bucket.len() as u32;
        self.chain[i] = std::mem::replace(&mut self.bucket[self.hash[i] as usize], variable);
        0
    }

    /// The variable touches nothing outside the new element: it leaves now, with the pivot.
    fn mass_eliminate(&mut self, pivot: u32, variable: u32) -> i32 {
        let weight = -self.weight[variable as usize];
        self.degree[pivot as usize] -= weight as u32;
        self.absorb_variable(pivot, variable);
        weight
    }

    /// `other` is eliminated together with `kept`, right after it.
    fn absorb_variable(&mut self, kept: u32, other: u32) {
        self.weight[other as usize] = 0;
        self.length[other as usize] = 0;
        self.stamp[other as usize] = 0;
        self.member[self.last_member[kept as usize] as usize] = other;
        self.last_member[kept as usize] = self.last_member[other as usize];
    }

    /// Merges touched variables whose lists hold the same entries.
    fn merge_indistinguishable(&mut self, touched: std::ops::Range<usize>) {
        for at in touched {
            let i = self.lists[at] as usize;
            if self.weight[i] == 0 {
                continue;
            }
            let mut kept = std::mem::replace(&mut self.bucket[self.hash[i] as usize], NONE);
            while kept != NONE && self.chain[kept as usize] != NONE {
                self.next_tag();
                self.merge_into(kept);
                kept = self.chain[kept as usize];
            }
        }
    }

    /// Merges into `kept` all its twins further down the hash chain.
    fn merge_into(&mut self, kept: u32) {
        let k = kept as usize;
        let entries = |q: &Self, i: usize| q.start[i] as usize..(q.start[i] + q.length[i]) as usize;
        for at in entries(self, k) {
            self.stamp[self.lists[at] as usize] = self.tag;
        }
        let (mut before, mut other) = (kept, self.chain[k]);
        while other != NONE {
            let o = other as usize;
            let next = self.chain[o];
            let twin = self.length[o] == self.length[k]
                && self.elements[o] == self.elements[k]
                && self.lists[entries(self, o)].iter().all(|&e| self.stamp[e as usize] == self.tag);
            if twin {
                self.weight[k] += self.weight[o];
                self.absorb_variable(kept, other);
                self.chain[before as usize] = next;
            } else {
                before = other;
            }
            other = next;
        }
    }

    /// Drops what left from the new element, gives the rest its degree and returns it to the degree lists.
    fn finish_element(&mut self, pivot: u32, touched: std::ops::Range<usize>) {
        let p = pivot as usize;
        let left = (self.sparse_vertices - self.eliminated) as u32;
        let mut to = touched.start;
        for at in touched.clone() {
            let variable = self.lists[at];
            let i = variable as usize;
            if self.weight[i] == 0 {
                continue;
            }
            self.weight[i] = -self.weight[i];
            let weight = self.weight[i] as u32;
            self.degree[i] = (self.degree[i] + self.degree[p] - weight).min(left - weight);
            self.lowest.insert(variable, self.degree[i] as usize);
            self.lists[to] = variable;
            to += 1;
        }
        if touched.end == self.lists.len() {
            self.lists.truncate(to);
        }
        self.length[p] = (to - touched.start) as u32;
        self.elements[p] = NONE; // marks an element
        if to == touched.start {
            self.stamp[p] = 0;
        }
    }

    /// Pivots in order, each followed by the vertices that left with it, then the dense vertices.
    fn order(&self, graph: &Graph) -> Vec<u32> {
        let n = graph.n();
        let mut order = Vec::with_capacity(n);
        for &pivot in &self.pivots {
            let mut at = pivot;
            while at != NONE {
                order.push(at);
                at = self.member[at as usize];
            }
        }
        order.extend((0..n as u32).filter(|&v| is_dense(graph.degree(v), n)));
        order
    }
}
