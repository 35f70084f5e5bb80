//! What the camera sees of each link: its visual shapes, or where it has none its collision shapes, as triangles.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, TriMesh};
use sagci_model::{Geometry, Shape};

use crate::rapier::TABLE_HALF_EXTENTS;
use crate::{Scene, WorldError, convert};

/// Triangles around a circle: a mug's wall then lies within 0.1 mm of its true circle.
const SEGMENTS: u32 = 48;
/// Colour of what names none.
const GREY: [f64; 4] = [0.7, 0.7, 0.72, 1.0];
/// Colour of the table.
const WOOD: [f64; 4] = [0.55, 0.42, 0.3, 1.0];

/// The visible surface of one link, in the link's frame.
pub(crate) struct Surface {
    /// Index of the thing (robot 0, then objects) and of its link; `None` for the table, which is given in the world.
    pub owner: Option<(usize, usize)>,
    pub mesh: TriMesh,
    /// Colour of each triangle.
    colors: Vec<[f64; 3]>,
    /// A ball around it.
    pub center: Point3<f64>,
    pub radius: f64,
}

impl Surface {
    /// Colour of a triangle under a light at the camera, seen under the cosine `facing`.
    pub(crate) fn color(&self, triangle: usize, facing: f64) -> [u8; 3] {
        // parry counts a triangle's back face as index + number of triangles.
        let color = self.colors.get(triangle % self.colors.len().max(1)).copied().unwrap_or([0.5; 3]);
        color.map(|c| (255.0 * c * (0.35 + 0.65 * facing)).clamp(0.0, 255.0) as u8)
    }

    fn new(owner: Option<(usize, usize)>, triangles: Triangles) -> Option<Self> {
        let mesh = TriMesh::new(triangles.vertices.iter().map(|p| convert::vector(&p.coords)).collect(), triangles.indices).ok()?;
        let bounds = mesh.local_aabb();
        let center = convert::point3((bounds.mins + bounds.maxs) / 2.0);
        let radius = triangles.vertices.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
        Some(Self { owner, mesh, colors: triangles.colors, center, radius })
    }
}

/// Surfaces of everything in the scene.
pub(crate) fn of(scene: &Scene) -> Result<Vec<Surface>, WorldError> {
    let mut surfaces = Vec::new();
    let models = std::iter::once(&scene.robot).chain(scene.objects.iter().map(|o| &o.model));
    for (thing, model) in models.enumerate() {
        for (link, l) in model.links.iter().enumerate() {
            let shapes = if l.visuals.is_empty() { &l.collisions } else { &l.visuals };
            let mut triangles = Triangles::default();
            for shape in shapes {
                triangles.add(shape);
            }
            if !triangles.indices.is_empty() {
                surfaces.push(Surface::new(Some((thing, link)), triangles).ok_or_else(|| WorldError::Scene {
                    place: format!("{}/{}", model.name, l.name),
                    message: "its visual shapes have no triangle that can be seen".into(),
                })?);
            }
        }
    }
    let mut table = Triangles::default();
    let [x, y, z] = TABLE_HALF_EXTENTS;
    table.add(&Shape {
        name: None,
        X_LG: Isometry3::from_parts(Translation3::new(0.0, 0.0, scene.table_height - z), UnitQuaternion::identity()),
        geometry: Geometry::Box { half_extents: Vector3::new(x, y, z) },
        rgba: Some(WOOD),
    });
    surfaces.extend(Surface::new(None, table));
    Ok(surfaces)
}

#[derive(Default)]
struct Triangles {
    vertices: Vec<Point3<f64>>,
    indices: Vec<[u32; 3]>,
    colors: Vec<[f64; 3]>,
}

impl Triangles {
    fn add(&mut self, shape: &Shape) {
        let along_z = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let ((points, indices), turned) = match &shape.geometry {
            Geometry::Box { half_extents } => (Cuboid::new(convert::vector(half_extents)).to_trimesh(), false),
            Geometry::Sphere { radius } => (Ball::new(*radius).to_trimesh(SEGMENTS, SEGMENTS / 2), false),
            Geometry::Cylinder { radius, half_length } => (Cylinder::new(*half_length, *radius).to_trimesh(SEGMENTS), true),
            Geometry::Capsule { radius, half_length } => (Capsule::new_y(*half_length, *radius).to_trimesh(SEGMENTS, SEGMENTS / 2), true),
            Geometry::Mesh { mesh, .. } => {
                ((mesh.vertices.iter().map(|v| convert::vector(&v.coords)).collect(), mesh.triangles.clone()), false)
            }
        };
        let X_LG = if turned { shape.X_LG * along_z } else { shape.X_LG };
        let first = self.vertices.len() as u32;
        self.vertices.extend(points.into_iter().map(|p| X_LG * convert::point3(p)));
        let [r, g, b, _] = shape.rgba.unwrap_or(GREY);
        self.colors.extend(indices.iter().map(|_| [r, g, b]));
        self.indices.extend(indices.into_iter().map(|t| t.map(|i| i + first)));
    }
}
