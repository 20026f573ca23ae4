//! Edges of a triangle mesh and the triangles at each edge. A *use* is the record of one triangle at one of its edges;
//! the records are sorted, so nothing depends on hashing.

/// One triangle's use of an edge.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Use {
    pub low: u32,
    pub high: u32,
    pub triangle: u32,
    /// Whether the triangle runs along the edge from the lower to the higher vertex index.
    pub forward: bool,
}

/// The uses of all edges. The uses of one edge are adjacent, in order of triangle.
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

    /// The uses of each edge.
    pub(super) fn groups(&self) -> impl Iterator<Item = &[Use]> {
        self.0.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high))
    }

    /// The two uses of each edge that has two triangles.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (Use, Use)> {
        self.groups().filter_map(|uses| if let &[a, b] = uses { Some((a, b)) } else { None })
    }

    /// The edges that have one triangle, directed as the triangle runs.
    pub(super) fn open(&self) -> impl Iterator<Item = [u32; 2]> {
        let run = |edge: &Use| if edge.forward { [edge.low, edge.high] } else { [edge.high, edge.low] };
        self.groups().filter(|uses| uses.len() == 1).map(move |uses| run(&uses[0]))
    }

    /// The directed edges that remain when each edge's uses in one direction are cancelled against those in the other:
    /// triangle fans must run against them to close the surface. For a consistently oriented surface they are its open
    /// edges; an edge of many triangles remains as often as its uses in the two directions differ.
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
