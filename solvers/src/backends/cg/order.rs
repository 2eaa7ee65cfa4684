//! Breadth-first numbering: neighbours lie close together, so that gathers hit the cache.
//!
//! From a row far out (the last one of a first search), level by level (Cuthill and McKee 1969, without their sorting by
//! degree). On a surface of n vertices the levels hold some sqrt(n) rows, so a product with the matrix touches a window of
//! that size; contiguous pieces of the numbering are strips with short borders, as threads like them.

/// Rows in breadth-first order, component by component.
pub(crate) fn breadth_first(starts: &[u32], columns: &[u32]) -> Vec<u32> {
    let n = starts.len() - 1;
    let mut rows = Vec::with_capacity(n);
    let mut seen = vec![0u8; n];
    for v in 0..n as u32 {
        if seen[v as usize] == 0 {
            let begin = rows.len();
            search(starts, columns, v, &mut rows, &mut seen, 1);
            let far = rows[rows.len() - 1];
            rows.truncate(begin);
            search(starts, columns, far, &mut rows, &mut seen, 2);
        }
    }
    rows
}

/// Appends to `rows` everything that can be reached from `start` over marks below `mark`, marking it.
fn search(starts: &[u32], columns: &[u32], start: u32, rows: &mut Vec<u32>, seen: &mut [u8], mark: u8) {
    let mut next = rows.len();
    rows.push(start);
    seen[start as usize] = mark;
    while let Some(&v) = rows.get(next) {
        next += 1;
        for &w in &columns[starts[v as usize] as usize..starts[v as usize + 1] as usize] {
            if seen[w as usize] < mark {
                seen[w as usize] = mark;
                rows.push(w);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two paths, 0-1-2-3 and 4-5; the search starts at an end of each.
    #[test]
    fn numbers_components_from_their_ends() {
        let (starts, columns) = ([0, 1, 3, 5, 6, 7, 8], [1, 0, 2, 1, 3, 2, 5, 4]);
        assert_eq!(breadth_first(&starts, &columns), [3, 2, 1, 0, 5, 4]);
    }
}
