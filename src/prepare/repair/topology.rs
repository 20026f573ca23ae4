//! Edges of a triangle mesh and the triangles at each edge, for the repair of surfaces. A *use* of an edge is the
//! record of one triangle that has this edge. The uses are sorted, so nothing depends on hashing.

/// One triangle's use of an edge, whose ends are the vertices `low` and `high` (the lower and the higher index).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Use {
    pub low: u32,
    pub high: u32,
    pub triangle: u32,
    /// Whether the triangle's corners run along the edge from `low` to `high`.
    pub forward: bool,
}

/// The uses of all edges. The uses of one edge are adjacent, in the order of their triangles.
pub(super) struct Edges(Vec<Use>);

impl Edges {
    pub(super) fn new(triangles: &[[u32; 3]]) -> Self {
        let edge = |(triangle, &[a, b, c]): (usize, &[u32; 3])| {
            [(a, b), (b, c), (c, a)].map(|(from, to)| Use {
                low: from.min(to),
                high: from.max(to),
                triangle: triangle as u32,
                forward: from < to,
            })
        };
        let mut uses: Vec<Use> = triangles.iter().enumerate().flat_map(edge).collect();
        uses.sort_unstable();
        Edges(uses)
    }

    /// For each edge, its uses.
    pub(super) fn groups(&self) -> impl Iterator<Item = &[Use]> {
        self.0.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high))
    }

    /// The two uses of each edge that has two triangles.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (Use, Use)> {
        self.groups().filter_map(|uses| if let &[a, b] = uses { Some((a, b)) } else { None })
    }

    /// The edges with one triangle, directed as the triangle's corners run.
    pub(super) fn open(&self) -> impl Iterator<Item = [u32; 2]> {
        let run = |edge: &Use| if edge.forward { [edge.low, edge.high] } else { [edge.high, edge.low] };
        self.groups().filter(|uses| uses.len() == 1).map(move |uses| run(&uses[0]))
    }

    /// The directed edges that remain when, at each edge, uses in one direction are cancelled against uses in the other
    /// direction. Triangles that close the surface must run against the remaining edges. In a consistently oriented
    /// surface only the edges with one triangle remain. An edge remains as often as the numbers of its uses in the two
    /// directions differ.
    pub(super) fn unmatched(&self) -> Vec<[u32; 2]> {
        let mut left = Vec::new();
        for uses in self.groups() {
            let balance: i64 = uses.iter().map(|edge| if edge.forward { 1 } else { -1 }).sum();
            let edge = if balance > 0 { [uses[0].low, uses[0].high] } else { [uses[0].high, uses[0].low] };
            left.extend(std::iter::repeat_n(edge, balance.unsigned_abs() as usize));
        }
        left
    }
}
