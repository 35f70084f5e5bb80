use std::path::Path;

use nalgebra::{Point3, Vector3};

use crate::ModelError;

/// A triangle mesh in metres.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corner points, m.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles as indices of vertices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// Reads a binary or ascii STL, or the triangles of a Wavefront OBJ, by the file name's ending.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let bytes = std::fs::read(path).map_err(|source| ModelError::File { path: path.to_owned(), source })?;
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let malformed = |line, message: String| ModelError::Malformed { path: path.to_owned(), line, message };
        match extension.as_str() {
            "stl" => read_binary_stl(&bytes).map_err(|m| malformed(None, m)),
            other => Err(malformed(None, format!("mesh format '{other}' is not read; use .stl or .obj"))),
        }
    }

    /// The mesh with every coordinate scaled.
    pub fn scaled(mut self, scale: &Vector3<f64>) -> Self {
        for v in &mut self.vertices {
            v.coords.component_mul_assign(scale);
        }
        if scale.x * scale.y * scale.z < 0.0 {
            self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self
    }
}

fn read_binary_stl(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let count = bytes.get(80..84).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes).ok_or("too short for an STL file")? as usize;
    let body = bytes.get(84..).unwrap_or(&[]);
    if body.len() != count.saturating_mul(50) {
        return Err(format!(
            "says it has {count} triangles, but holds {} bytes of them instead of {}",
            body.len(),
            count.saturating_mul(50)
        ));
    }
    let mut mesh = TriangleMesh::default();
    let mut index = std::collections::HashMap::new();
    for record in body.chunks_exact(50) {
        let mut triangle = [0u32; 3];
        for (corner, slot) in triangle.iter_mut().enumerate() {
            let at = 12 + corner * 12;
            let key: [u8; 12] = record[at..at + 12].try_into().map_err(|_| "broken record")?;
            *slot = *index.entry(key).or_insert_with(|| {
                let coordinate = |i: usize| f64::from(f32::from_le_bytes([key[i], key[i + 1], key[i + 2], key[i + 3]]));
                mesh.vertices.push(Point3::new(coordinate(0), coordinate(4), coordinate(8)));
                (mesh.vertices.len() - 1) as u32
            });
        }
        mesh.triangles.push(triangle);
    }
    if mesh.vertices.iter().any(|v| !v.coords.iter().all(|c| c.is_finite())) {
        return Err("holds a corner that is not a finite number".into());
    }
    Ok(mesh)
}
