//! The bounding volume hierarchy: obvhs builds a binary tree, which is collapsed to four children a
//! node and traversed here. The only file that knows obvhs.
//!
//! Its own traversals are not used: CWBVH clamps box entry to an absolute 1e-4 and loses hits in
//! small scenes. Boxes here are tested from the ray's own start, and the exit distance is widened by
//! `1 + 2 gamma(3)` (Ize, "Robust BVH Ray Traversal", JCGT 2(2) 2013), so no box is missed by
//! rounding at any scale.

use super::triangle::{Block, MASKED, Shear};
use super::{Build, Hit, Ray};
use crate::scene::Scene;
use glam::{Vec3, Vec4};
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::{BvhBuildParams, triangle::Triangle as BuildTriangle};
use std::time::Duration;

/// `1 + 2 gamma(3)`, gamma(n) = n u / (1 - n u), u = 2^-24: the slab test subtracts, inverts and
/// multiplies, one rounding each.
const EXIT_SLACK: f32 = 1.0 + 2.0 * (3.0 * 0.5 * f32::EPSILON);

/// The same for the entry distance.
const ENTRY_SLACK: f32 = 1.0 - 2.0 * (3.0 * 0.5 * f32::EPSILON);

/// Deepest stack: obvhs trees of 2^31 triangles stay below this depth, three entries a level.
const STACK: usize = 256;

/// Nodes still to be visited, nearest on top, each with the distance at which the ray enters it. Made
/// once a batch: clearing it for every ray would cost as much as a tenth of the traversal.
pub struct Stack([(f32, u32); STACK]);

impl Default for Stack {
    fn default() -> Self {
        Self([(0.0, 0); STACK])
    }
}

/// Children are inner nodes, leaves (bit 31: first block and count) or absent.
const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 27;
const MAX_LEAF_BLOCKS: u32 = 15;
const ABSENT: u32 = u32::MAX;

/// Four boxes side by side, and where they lead.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
struct Node {
    min: [Vec4; 3],
    max: [Vec4; 3],
    child: [u32; 4],
}

/// The hierarchy over one scene's light-blocking triangles.
pub struct Accel {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
}

/// What the box test needs of a ray.
struct Slabs {
    origin: Vec3,
    inverse: Vec3,
    near_is_max: [bool; 3],
}

impl Slabs {
    fn of(ray: &Ray) -> Self {
        // A zero component gives the largest finite inverse: the product with a distance of zero
        // is then zero, never NaN.
        let inverse = ray
            .direction
            .recip()
            .clamp(Vec3::splat(f32::MIN), Vec3::splat(f32::MAX));
        Self {
            origin: ray.origin,
            inverse,
            near_is_max: [inverse.x < 0.0, inverse.y < 0.0, inverse.z < 0.0],
        }
    }

    /// Entry distances of the four boxes, rounded down by the same bound so that a triangle at
    /// exactly `limit` is still reached (ties go to the lowest number), and which are entered.
    #[inline]
    fn enter(&self, node: &Node, limit: f32) -> (Vec4, u32) {
        let mut near = Vec4::ZERO;
        let mut far = Vec4::splat(limit);
        for axis in 0..3 {
            let (a, b) = if self.near_is_max[axis] {
                (node.max[axis], node.min[axis])
            } else {
                (node.min[axis], node.max[axis])
            };
            near = near.max((a - self.origin[axis]) * self.inverse[axis]);
            far = far.min((b - self.origin[axis]) * self.inverse[axis] * EXIT_SLACK);
        }
        let near = near * ENTRY_SLACK;
        (near, near.cmple(far).bitmask())
    }
}

impl Accel {
    /// Builds the hierarchy over the triangles whose role blocks light.
    pub fn build(scene: &Scene, build: Build) -> Self {
        let ids: Vec<u32> = (0..scene.triangles.len() as u32)
            .filter(|&t| scene.role_of(t).blocks_light())
            .collect();
        if ids.is_empty() {
            return Self {
                nodes: Vec::new(),
                blocks: Vec::new(),
            };
        }
        let triangles: Vec<BuildTriangle> = ids
            .iter()
            .map(|&t| {
                let [a, b, c] = scene.corners(t).map(Into::into);
                BuildTriangle {
                    v0: a,
                    v1: b,
                    v2: c,
                }
            })
            .collect();
        let mut params = match build {
            Build::Fast => BvhBuildParams::fast_build(),
            Build::Good => BvhBuildParams::medium_build(),
        };
        params.pre_split = false;
        params.max_prims_per_leaf = 4;
        let bvh = build_bvh2_from_tris(&triangles, params, &mut Duration::default());
        let mut accel = Self {
            nodes: Vec::new(),
            blocks: Vec::new(),
        };
        let root = accel.collapse(scene, &ids, &bvh, 0);
        if root & LEAF != 0 {
            let aabb = bvh.nodes[0].aabb;
            let node = accel.node_of(&[(Vec3::from(aabb.min), Vec3::from(aabb.max), root)]);
            accel.nodes.push(node);
        }
        accel
    }

    /// Bytes of nodes and triangles.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.blocks.as_slice())
    }

    fn node_of(&self, children: &[(Vec3, Vec3, u32)]) -> Node {
        let mut node = Node {
            min: [Vec4::INFINITY; 3],
            max: [Vec4::NEG_INFINITY; 3],
            child: [ABSENT; 4],
        };
        for (lane, (min, max, child)) in children.iter().enumerate() {
            for axis in 0..3 {
                node.min[axis][lane] = min[axis];
                node.max[axis][lane] = max[axis];
            }
            node.child[lane] = *child;
        }
        node
    }

    /// Collapses the binary subtree at `index`; returns its child code. Depth is bounded by the
    /// binary tree's, which obvhs keeps near the logarithm of the triangle count.
    fn collapse(&mut self, scene: &Scene, ids: &[u32], bvh: &Bvh2, index: usize) -> u32 {
        let node = &bvh.nodes[index];
        if node.is_leaf() {
            let first = node.first_index as usize;
            let members = &bvh.primitive_indices[first..first + node.prim_count as usize];
            let mut members: Vec<u32> = members.iter().map(|&p| ids[p as usize]).collect();
            members.sort_unstable();
            let start = self.blocks.len() as u32;
            for four in members.chunks(4) {
                let lanes: Vec<_> = four
                    .iter()
                    .map(|&t| {
                        let masked = scene.material_of(t).alpha_cutoff.is_some();
                        (scene.corners(t), if masked { t | MASKED } else { t })
                    })
                    .collect();
                self.blocks.push(Block::new(&lanes));
            }
            let count = self.blocks.len() as u32 - start;
            assert!(
                count <= MAX_LEAF_BLOCKS && start < 1 << COUNT_SHIFT,
                "leaf fits its code"
            );
            return LEAF | count << COUNT_SHIFT | start;
        }
        // Open the largest inner child until four are found.
        let first = node.first_index as usize;
        let mut open = vec![first, first + 1];
        while open.len() < 4 {
            let largest = (0..open.len())
                .filter(|&i| !bvh.nodes[open[i]].is_leaf())
                .max_by(|&i, &j| {
                    let area = |k: usize| bvh.nodes[open[k]].aabb.half_area();
                    area(i).total_cmp(&area(j)).then(j.cmp(&i))
                });
            let Some(i) = largest else { break };
            let first = bvh.nodes[open[i]].first_index as usize;
            open[i] = first;
            open.insert(i + 1, first + 1);
        }
        let slot = self.nodes.len();
        self.nodes.push(self.node_of(&[]));
        let children: Vec<_> = open
            .iter()
            .map(|&i| {
                let aabb = bvh.nodes[i].aabb;
                let code = self.collapse(scene, ids, bvh, i);
                (Vec3::from(aabb.min), Vec3::from(aabb.max), code)
            })
            .collect();
        self.nodes[slot] = self.node_of(&children);
        slot as u32
    }

    /// Closest hit; `covers` decides about alpha-masked triangles.
    #[inline]
    pub fn closest(&self, ray: &Ray, stack: &mut Stack, covers: impl Fn(&Hit) -> bool) -> Hit {
        let mut best = Hit {
            t: ray.limit,
            ..Hit::MISS
        };
        self.walk(ray, stack, |block, shear, limit| {
            block.intersect(shear, limit, |hit, masked| {
                let nearer = hit.t < best.t || (hit.t == best.t && hit.triangle < best.triangle);
                if nearer
                    && hit.triangle != ray.skip
                    && hit.t < ray.limit
                    && (!masked || covers(&hit))
                {
                    best = hit;
                }
            });
            Some(best.t)
        });
        if best.is_hit() { best } else { Hit::MISS }
    }

    /// Whether any triangle is hit within the ray's limit.
    #[inline]
    pub fn occluded(&self, ray: &Ray, stack: &mut Stack, covers: impl Fn(&Hit) -> bool) -> bool {
        let mut blocked = false;
        self.walk(ray, stack, |block, shear, limit| {
            block.intersect(shear, limit, |hit, masked| {
                blocked |= hit.t < limit && hit.triangle != ray.skip && (!masked || covers(&hit));
            });
            if blocked { None } else { Some(limit) }
        });
        blocked
    }

    /// Visits the blocks of every leaf the ray enters, nearest child first, until `visit` returns
    /// `None`; otherwise it returns the new limit.
    #[inline]
    fn walk(
        &self,
        ray: &Ray,
        Stack(stack): &mut Stack,
        mut visit: impl FnMut(&Block, &Shear, f32) -> Option<f32>,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let slabs = Slabs::of(ray);
        let shear = Shear::of(ray);
        let mut limit = ray.limit;
        stack[0] = (0.0, 0);
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (near, code) = stack[top];
            if near > limit {
                continue;
            }
            if code & LEAF != 0 {
                let start = (code & ((1 << COUNT_SHIFT) - 1)) as usize;
                let count = ((code & !LEAF) >> COUNT_SHIFT) as usize;
                for block in &self.blocks[start..start + count] {
                    match visit(block, &shear, limit) {
                        Some(new) => limit = new,
                        None => return,
                    }
                }
                continue;
            }
            let node = &self.nodes[code as usize];
            let (near, mut entered) = slabs.enter(node, limit);
            let base = top;
            while entered != 0 {
                let lane = entered.trailing_zeros() as usize;
                entered &= entered - 1;
                // Insertion keeps the nearest on top.
                let item = (near[lane], node.child[lane]);
                let mut at = top;
                while at > base && stack[at - 1].0 < item.0 {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = item;
                top += 1;
            }
        }
    }
}
