//! Entry cells: where light first meets the scene. Surface samples are clustered by an
//! object-median kd-tree over position and normal (S4 section 5.1); a cell is a leaf, its entry
//! points are the quadrature nodes of its mean direct irradiance (dossier 5.3).
//!
//! Deviation from the paper: a cell is not the set of its entry points but the leaf's region of
//! (position, normal) space, so any hit is assigned to its cell by a descent of the tree. Cells
//! never join opposite sides (one tree for each of the six dominant normal directions), and are
//! split wherever a plane separates samples that are hidden from each other.

use crate::scene::Scene;
use crate::scene::surface::{Facet, SurfacePoint, Surfaces};
use glam::{DVec3, Vec3};

/// Samples drawn for each cell: enough that sixteen strata of it are even to a few percent.
const SAMPLES_PER_CELL: u32 = 256;

/// No split by sight leaves fewer samples than this on a side: an eighth of a cell.
const FEWEST_SAMPLES: usize = 32;

/// A split by sight must leave no more than this share of the impurity: only a plane that really
/// separates what is hidden (a wall) is worth a cell; scattered clutter is not.
const IMPURITY_LEFT: f64 = 0.25;

/// Samples of a leaf that are tested for sight of its middle.
const SIGHT_TESTS: usize = 32;

/// How finely light entry is resolved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellOptions {
    /// Cells aimed at; splits by sight and small sides add to it.
    pub cells: u32,
    /// Entry points a cell (fewer only where a cell is too small to hold as many samples).
    pub entries_per_cell: u32,
}

/// Answers, for segments between two points in open space, which are unobstructed.
pub type Sight<'a> = &'a (dyn Fn(&[(Vec3, Vec3)]) -> Vec<bool> + Sync);

/// The cells of one scene.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    /// Entry points, sorted by cell.
    pub entries: Vec<SurfacePoint>,
    /// `entries[first_entry[c]..first_entry[c + 1]]` belong to cell `c`.
    pub first_entry: Vec<u32>,
    /// Area-uniform samples, sorted by cell: where the bounce operator's rays start.
    pub samples: Vec<SurfacePoint>,
    /// `samples[first_sample[c]..first_sample[c + 1]]` belong to cell `c`.
    pub first_sample: Vec<u32>,
    /// Cells some of whose samples do not see the middle one, and no plane separates them.
    pub hidden_pairs: u32,
    nodes: Vec<Node>,
    /// Node from which the descent starts for the front and back of each triangle.
    start: Vec<[u32; 2]>,
}

/// `key[axis] > threshold` goes to `child + 1`, else to `child`; `axis == LEAF`: `child` is the cell.
#[derive(Debug, Clone, Copy)]
struct Node {
    threshold: f32,
    axis: u32,
    child: u32,
}

const LEAF: u32 = 6;

/// Position and normal as the tree compares them.
type Key = [f32; 6];

fn key(position: Vec3, normal: Vec3) -> Key {
    [
        position.x, position.y, position.z, normal.x, normal.y, normal.z,
    ]
}

/// Which of six directions a normal is closest to: `+x -x +y -y +z -z`.
fn side(normal: Vec3) -> usize {
    let axis = normal.abs().max_position();
    2 * axis + usize::from(normal[axis] < 0.0)
}

impl Cells {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.first_entry.len().saturating_sub(1)
    }

    /// Whether there is no cell: nothing in the scene reflects or blocks light.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Cell of a point on `triangle`.
    #[inline]
    pub fn find(&self, point: &SurfacePoint) -> u32 {
        let key = key(point.position, point.normal);
        let mut node =
            &self.nodes[self.start[point.triangle as usize][usize::from(!point.front)] as usize];
        while node.axis != LEAF {
            let right = key[node.axis as usize] > node.threshold;
            node = &self.nodes[(node.child + u32::from(right)) as usize];
        }
        node.child
    }

    /// Builds the cells of all surfaces that face light: fronts, and backs of double-sided ones.
    pub fn build(scene: &Scene, surfaces: &Surfaces, options: &CellOptions, sight: Sight) -> Self {
        let (samples, area) = draw_samples(scene, surfaces, options);
        if samples.is_empty() {
            return Self::default();
        }
        let cell_size = (area / f64::from(options.cells)).sqrt() as f32;
        let mut tree = Builder {
            samples: &samples,
            normal_scale: cell_size * 0.5,
            leaf_samples: SAMPLES_PER_CELL as usize,
            nodes: Vec::new(),
            leaves: Vec::new(),
            sight,
            hidden: 0,
        };
        let mut members: [Vec<u32>; 6] = Default::default();
        for (i, sample) in samples.iter().enumerate() {
            members[side(sample.normal)].push(i as u32);
        }
        tree.nodes.resize(
            6,
            Node {
                threshold: 0.0,
                axis: LEAF,
                child: 0,
            },
        );
        for (root, mut members) in members.into_iter().enumerate() {
            if !members.is_empty() {
                tree.grow(root, &mut members);
            }
        }
        let Builder {
            nodes,
            leaves,
            hidden,
            ..
        } = tree;
        let mut cells = Self {
            nodes,
            hidden_pairs: hidden,
            ..Self::default()
        };
        cells.first_entry.push(0);
        cells.first_sample.push(0);
        for leaf in &leaves {
            let points: Vec<SurfacePoint> = leaf.iter().map(|&i| samples[i as usize]).collect();
            pick_entries(
                points.clone(),
                options.entries_per_cell as usize,
                &mut cells.entries,
            );
            cells.samples.extend(points);
            cells.first_entry.push(cells.entries.len() as u32);
            cells.first_sample.push(cells.samples.len() as u32);
        }
        let (lift, triangles) = (surfaces.lift(), 0..scene.triangles.len() as u32);
        cells.start = triangles
            .map(|t| [true, false].map(|front| cells.deepest(surfaces.facet(t), front, lift)))
            .collect();
        cells
    }

    /// Deepest node whose region contains a whole triangle: hits on it start there.
    fn deepest(&self, facet: &Facet, front: bool, lift: f32) -> u32 {
        let normal = if front { facet.normal } else { -facet.normal };
        let corners = facet.corners();
        let mut index = side(normal) as u32;
        loop {
            let node = &self.nodes[index as usize];
            if node.axis == LEAF {
                return index;
            }
            // Hits lie inside the triangle but for the lift off it and less than that in rounding.
            let axis = node.axis as usize;
            let above = |c: &Vec3| key(*c, normal)[axis] - node.threshold > 2.0 * lift;
            let below = |c: &Vec3| node.threshold - key(*c, normal)[axis] > 2.0 * lift;
            let exact = node.axis >= 3;
            index = if exact {
                node.child + u32::from(key(corners[0], normal)[axis] > node.threshold)
            } else if corners.iter().all(above) {
                node.child + 1
            } else if corners.iter().all(below) {
                node.child
            } else {
                return index;
            };
        }
    }
}

/// Area-proportional samples over all reflecting sides, systematic over triangles and Sobol within
/// each; and the total area of these sides, m².
fn draw_samples(
    scene: &Scene,
    surfaces: &Surfaces,
    options: &CellOptions,
) -> (Vec<SurfacePoint>, f64) {
    let mut sides: Vec<(u32, bool, f64)> = Vec::new();
    for t in 0..scene.triangles.len() as u32 {
        let facet = surfaces.facet(t);
        if scene.role_of(t).blocks_light() {
            let area = facet.area();
            sides.push((t, true, area));
            if facet.double_sided() {
                sides.push((t, false, area));
            }
        }
    }
    let area: f64 = sides.iter().map(|s| s.2).sum();
    let total = u64::from(options.cells) * u64::from(SAMPLES_PER_CELL);
    let mut samples = Vec::with_capacity(total as usize);
    let mut seen = [false; 6];
    let (mut before, mut drawn) = (0.0_f64, 0_u64);
    for &(triangle, front, side_area) in &sides {
        before += side_area;
        // Samples up to the end of this side: the integer part of its share of the running sum.
        let upto = ((before / area) * total as f64 + 0.5).floor() as u64;
        let facet = surfaces.facet(triangle);
        let direction = side(if front { facet.normal } else { -facet.normal });
        let count = upto.saturating_sub(drawn).max(u64::from(!seen[direction]));
        seen[direction] = true;
        drawn = drawn.max(upto);
        for i in 0..count {
            let (u, v) = lattice(i, count);
            samples.push(surfaces.point(scene, triangle, u, v, front));
        }
    }
    (samples, area)
}

/// Point `i` of `n` of the rank-1 golden-ratio lattice, mapped to barycentric `(u, v)` by the
/// low-distortion map (Heitz 2019).
fn lattice(i: u64, n: u64) -> (f32, f32) {
    let x = (i as f64 + 0.5) / n as f64;
    let y = ((i as f64 + 0.5) * 0.618_033_988_749_894_9).fract();
    let (x, y) = (x as f32, y as f32);
    if y > x {
        (x * 0.5, y - x * 0.5)
    } else {
        (x - y * 0.5, y * 0.5)
    }
}

struct Builder<'a> {
    samples: &'a [SurfacePoint],
    /// Metres that a unit of normal difference counts as.
    normal_scale: f32,
    leaf_samples: usize,
    nodes: Vec<Node>,
    leaves: Vec<Vec<u32>>,
    sight: Sight<'a>,
    hidden: u32,
}

impl Builder<'_> {
    fn key(&self, sample: u32) -> Key {
        let s = &self.samples[sample as usize];
        key(s.position, s.normal)
    }

    /// Splits `members` below `node` at the object median of the widest dimension until leaves are
    /// small enough, then by sight.
    fn grow(&mut self, node: usize, members: &mut [u32]) {
        // Halving reaches sizes between n/sqrt(2) and n sqrt(2) around the aim.
        let small = members.len() * members.len() <= 2 * self.leaf_samples * self.leaf_samples;
        let split = if small {
            self.split_by_sight(members)
        } else {
            self.median(members)
        };
        let Some((axis, threshold)) = split else {
            self.nodes[node] = Node {
                threshold: 0.0,
                axis: LEAF,
                child: self.leaves.len() as u32,
            };
            self.leaves.push(members.to_vec());
            return;
        };
        let samples = self.samples;
        let at = |i: &u32| key(samples[*i as usize].position, samples[*i as usize].normal)[axis];
        members.sort_unstable_by(|i, j| at(i).total_cmp(&at(j)).then(i.cmp(j)));
        let middle = members.partition_point(|i| at(i) <= threshold);
        let child = self.nodes.len();
        let blank = Node {
            threshold: 0.0,
            axis: LEAF,
            child: 0,
        };
        self.nodes.extend([blank, blank]);
        self.nodes[node] = Node {
            threshold,
            axis: axis as u32,
            child: child as u32,
        };
        let (left, right) = members.split_at_mut(middle);
        self.grow(child, left);
        self.grow(child + 1, right);
    }

    fn extents(&self, members: &[u32]) -> Key {
        let mut low = [f32::INFINITY; 6];
        let mut high = [f32::NEG_INFINITY; 6];
        for &i in members {
            for (axis, x) in self.key(i).into_iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        std::array::from_fn(|axis| {
            (high[axis] - low[axis]) * if axis >= 3 { self.normal_scale } else { 1.0 }
        })
    }

    /// Object median along the widest dimension; `None` when all members coincide.
    fn median(&self, members: &[u32]) -> Option<(usize, f32)> {
        let extents = self.extents(members);
        let axis = (0..6).max_by(|&i, &j| extents[i].total_cmp(&extents[j]).then(j.cmp(&i)))?;
        let mut values: Vec<f32> = members.iter().map(|&i| self.key(i)[axis]).collect();
        values.sort_unstable_by(f32::total_cmp);
        let high = values[values.len() - 1];
        let mut threshold = values[(values.len() - 1) / 2];
        if threshold >= high {
            // Many equal values at the top: cut below them.
            threshold = values[values.partition_point(|&x| x < high).checked_sub(1)?];
        }
        Some((axis, threshold))
    }

    /// The split that best separates the members that see the middle one from those that do not;
    /// `None` when all see it or the leaf is too small.
    fn split_by_sight(&mut self, members: &[u32]) -> Option<(usize, f32)> {
        if members.len() < 2 * FEWEST_SAMPLES {
            return None;
        }
        let stride = members.len().div_ceil(SIGHT_TESTS);
        let tested: Vec<u32> = members.iter().copied().step_by(stride).collect();
        let points: Vec<&SurfacePoint> =
            tested.iter().map(|&i| &self.samples[i as usize]).collect();
        let centre: DVec3 =
            points.iter().map(|p| p.position.as_dvec3()).sum::<DVec3>() / points.len() as f64;
        let distance = |p: &SurfacePoint| p.position.as_dvec3().distance_squared(centre);
        let middle = (0..points.len())
            .min_by(|&i, &j| distance(points[i]).total_cmp(&distance(points[j])))?;
        // Lift both ends by a quarter of the leaf's width, so that a curved surface does not hide
        // its own neighbours; in a narrow gap only as far as there is room.
        let extents = self.extents(members);
        let lift = 0.25 * extents[..3].iter().fold(0.0_f32, |a, &b| a.max(b));
        let raised: Vec<Vec3> = points
            .iter()
            .map(|p| p.position + p.normal * lift)
            .collect();
        let room: Vec<_> = points
            .iter()
            .zip(&raised)
            .map(|(p, &r)| (p.position, r))
            .collect();
        let free = (self.sight)(&room);
        let ends: Vec<Vec3> = (0..points.len())
            .map(|i| {
                if free[i] {
                    raised[i]
                } else {
                    points[i].position
                }
            })
            .collect();
        let pairs: Vec<_> = ends.iter().map(|&e| (ends[middle], e)).collect();
        let mut seen = (self.sight)(&pairs);
        seen[middle] = true;
        if seen.iter().all(|&s| s) {
            return None;
        }
        let best = self
            .purest_split(&tested, &seen)
            .filter(|&(axis, threshold)| {
                let left = members
                    .iter()
                    .filter(|&&i| self.key(i)[axis] <= threshold)
                    .count();
                left.min(members.len() - left) >= FEWEST_SAMPLES
            });
        if best.is_none() {
            self.hidden += 1;
        }
        best
    }

    /// Threshold on a position axis with the lowest Gini impurity of `seen`, if low enough.
    fn purest_split(&self, tested: &[u32], seen: &[bool]) -> Option<(usize, f32)> {
        let total = seen.len() as f64;
        let impurity = |n: f64, k: f64| if n > 0.0 { k * (n - k) / n } else { 0.0 };
        let yes = seen.iter().filter(|&&s| s).count() as f64;
        let mut best = (impurity(total, yes) * IMPURITY_LEFT, None);
        for axis in 0..3 {
            let mut order: Vec<(f32, bool)> = tested
                .iter()
                .zip(seen)
                .map(|(&i, &s)| (self.key(i)[axis], s))
                .collect();
            order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut below = 0.0;
            for i in 0..order.len() - 1 {
                below += f64::from(u8::from(order[i].1));
                let n = (i + 1) as f64;
                let cost = impurity(n, below) + impurity(total - n, yes - below);
                let (low, high) = (order[i].0, order[i + 1].0);
                if low < high && cost < best.0 {
                    // The middle of neighbouring floats may round up to `high`, which would then
                    // fall on the left too and leave the right side empty.
                    let middle = 0.5 * (low + high);
                    let threshold = if middle < high { middle } else { low };
                    best = (cost, Some((axis, threshold)));
                }
            }
        }
        best.1
    }
}

/// Halves `points` along their widest extent until there are `count` strata and keeps the point
/// nearest to each stratum's centre.
fn pick_entries(mut points: Vec<SurfacePoint>, count: usize, out: &mut Vec<SurfacePoint>) {
    if points.len() <= 1 || count <= 1 {
        let n = points.len() as f64;
        let centre: DVec3 = points.iter().map(|p| p.position.as_dvec3()).sum::<DVec3>() / n;
        let nearest = points.iter().min_by(|a, b| {
            let d = |p: &SurfacePoint| p.position.as_dvec3().distance_squared(centre);
            d(a).total_cmp(&d(b))
        });
        out.extend(nearest);
        return;
    }
    let (low, high) = points
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| {
            (l.min(p.position), h.max(p.position))
        });
    let axis = (high - low).max_position();
    points.sort_by(|a, b| a.position[axis].total_cmp(&b.position[axis]));
    let left_count = count / 2;
    let right = points.split_off(points.len() * left_count / count);
    pick_entries(points, left_count, out);
    pick_entries(right, count - left_count, out);
}
