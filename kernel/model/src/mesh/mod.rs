//! Triangle meshes: read from STL and OBJ, measured, and written as binary STL.

mod obj;
mod stl;

use std::collections::HashMap;
use std::path::Path;

use nalgebra::{Point3, Vector3};

use crate::ModelError;
use crate::text::{MESH_BYTES, read_bytes};

/// Greatest number of triangles that are read.
const TRIANGLES: usize = 2_000_000;

/// A triangle mesh in metres.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corner points, m.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles as indices of vertices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// What is wrong in a mesh file, and on which line if it is a text.
struct MeshError {
    line: Option<usize>,
    message: String,
}

impl From<String> for MeshError {
    fn from(message: String) -> Self {
        Self { line: None, message }
    }
}

impl TriangleMesh {
    /// Reads a binary or ascii STL, or the triangles of a Wavefront OBJ, by the file name's ending. Corners with equal
    /// coordinates become one vertex; triangles with two equal corners are left out.
    ///
    /// Errors: a file that is missing, too large or broken (with the line where it is a text), a coordinate that is not
    /// finite, no triangle at all.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let malformed = |line, message| ModelError::Malformed { path: path.to_owned(), line, message };
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let parse = match extension.as_str() {
            "stl" => stl::parse,
            "obj" => obj::parse,
            "dae" => return Err(malformed(None, "COLLADA meshes are not read; convert it to .stl or .obj".into())),
            other => return Err(malformed(None, format!("meshes of the kind '.{other}' are not read; use .stl or .obj"))),
        };
        let bytes = read_bytes(path, MESH_BYTES)?;
        parse(&bytes).map_err(|e| malformed(e.line, e.message))
    }

    /// The mesh with every coordinate scaled. A mirrored mesh has its triangles turned over, so that outside stays outside.
    pub fn scaled(mut self, scale: &Vector3<f64>) -> Self {
        for v in &mut self.vertices {
            v.coords.component_mul_assign(scale);
        }
        if scale.x * scale.y * scale.z < 0.0 {
            self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self
    }

    /// Is it the whole surface of a solid: does every edge of a triangle have its opposite in another?
    pub fn is_closed(&self) -> bool {
        let mut edges: HashMap<(u32, u32), i64> = HashMap::with_capacity(self.triangles.len() * 3);
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        !edges.is_empty() && edges.values().all(|&n| n == 0)
    }

    /// Enclosed volume, m^3: the sum of the signed tetrahedra over the origin. It is meaningful if the mesh is closed, and
    /// negative if its triangles face inwards.
    pub fn volume(&self) -> f64 {
        let at = |i: u32| self.vertices[i as usize].coords;
        self.triangles.iter().map(|&[a, b, c]| at(a).dot(&at(b).cross(&at(c)))).sum::<f64>() / 6.0
    }

    /// Area of all triangles, m^2.
    pub fn area(&self) -> f64 {
        let at = |i: u32| self.vertices[i as usize].coords;
        self.triangles.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(&(at(c) - at(a))).norm()).sum::<f64>() / 2.0
    }

    /// Least and greatest coordinates, m; zero for an empty mesh.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let mut vertices = self.vertices.iter();
        let Some(first) = vertices.next() else { return (Point3::origin(), Point3::origin()) };
        vertices.fold((*first, *first), |(lo, hi), v| (lo.inf(v), hi.sup(v)))
    }

    /// Does it span space: can a solid be made around its points? A flat or line-like mesh does not.
    pub fn has_thickness(&self) -> bool {
        // The spread about the mean in the direction in which it is least, against the greatest.
        let n = self.vertices.len() as f64;
        let mean = self.vertices.iter().map(|v| v.coords).sum::<Vector3<f64>>() / n.max(1.0);
        let mut spread = nalgebra::Matrix3::zeros();
        for v in &self.vertices {
            let d = v.coords - mean;
            spread += d * d.transpose();
        }
        let eigenvalues = spread.symmetric_eigenvalues();
        eigenvalues.min() > 1e-10 * eigenvalues.max() && eigenvalues.max() > 0.0
    }

    /// The bytes of a binary STL; coordinates become single precision.
    pub fn to_stl(&self) -> Vec<u8> {
        stl::write(self)
    }
}

/// Collects triangles whose corners are given by their coordinates; equal corners become one vertex.
#[derive(Default)]
struct Welder {
    mesh: TriangleMesh,
    index: HashMap<[u64; 3], u32>,
}

impl Welder {
    fn vertex(&mut self, p: [f64; 3]) -> Result<u32, String> {
        if !p.iter().all(|c| c.is_finite() && c.abs() < 1e6) {
            return Err(format!("holds the corner {p:?}, which is not a place; coordinates are finite numbers in metres"));
        }
        // Adding zero makes -0 and 0 one corner.
        let key = p.map(|c| (c + 0.0).to_bits());
        Ok(*self.index.entry(key).or_insert_with(|| {
            self.mesh.vertices.push(Point3::from(p));
            (self.mesh.vertices.len() - 1) as u32
        }))
    }

    fn triangle(&mut self, corners: [[f64; 3]; 3]) -> Result<(), String> {
        let t = [self.vertex(corners[0])?, self.vertex(corners[1])?, self.vertex(corners[2])?];
        if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
            self.mesh.triangles.push(t);
        }
        if self.mesh.triangles.len() > TRIANGLES {
            return Err(format!("has more than the {TRIANGLES} triangles that are read; make it coarser"));
        }
        Ok(())
    }

    fn finish(self) -> Result<TriangleMesh, String> {
        if self.mesh.triangles.is_empty() {
            return Err("holds no triangle".into());
        }
        Ok(self.mesh)
    }
}
