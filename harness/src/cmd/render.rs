//! `render`: a mesh, a field on it, or a sequence of poses as PNG.

use super::Outcome;
use crate::exit::Exit;
use crate::mesh_io::frames::{self, Frames};
use crate::mesh_io::npy;
use crate::mesh_io::table;
use crate::mesh_source;
use crate::render::animation::write_apng;
use crate::render::{Camera, Colouring, Image, Style, Up, View, contact_sheet, draw};
use crate::vector::Vector;
use anyhow::{Context, bail};
use lapsolve::mesh::TriangleMesh;
use std::path::{Path, PathBuf};

/// Draw a mesh, a field on it, or a sequence of poses as PNG
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The mesh: a file or a generated one such as `body:50000`
    #[arg(long, value_name = "MESH")]
    mesh: String,
    /// Where the picture goes
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// Colour by a field: one row per vertex, k numbers. Four columns are shown as rotations unless --column picks one
    #[arg(long, value_name = "FILE.csv|FILE.npy")]
    field: Option<PathBuf>,
    /// Column of the field, from 0
    #[arg(long, value_name = "K", requires = "field")]
    column: Option<usize>,
    /// Mark the vertices of a constraints file with dots
    #[arg(long, value_name = "FILE.csv")]
    constraints: Option<PathBuf>,
    /// Poses of the mesh, drawn as a contact sheet: shape frames x vertices x 3, or a folder of meshes
    #[arg(long, value_name = "FILE.npy|FOLDER")]
    frames: Option<PathBuf>,
    /// Poses on the contact sheet, evenly spaced
    #[arg(long, value_name = "N", default_value_t = 16, requires = "frames", value_parser = clap::value_parser!(u32).range(1..=400))]
    pictures: u32,
    /// All poses as an animated PNG with so many frames per second, instead of a contact sheet
    #[arg(long, value_name = "HZ", requires = "frames", value_parser = clap::value_parser!(u16).range(1..=240))]
    animate: Option<u16>,
    /// Width and height in pixels of one picture
    #[arg(long, value_name = "WxH", default_value = "800x800", value_parser = size)]
    size: (usize, usize),
    /// Where the viewer stands
    #[arg(long, value_enum, default_value_t)]
    view: View,
    /// Which axis points up
    #[arg(long, value_enum, default_value_t)]
    up: Up,
    /// Perspective instead of parallel projection
    #[arg(long)]
    perspective: bool,
    /// One normal per triangle: shows the triangulation
    #[arg(long)]
    flat: bool,
}

/// Largest width and height of one picture: 50 MB of pixels.
const LARGEST: usize = 4096;

/// Parses `WIDTHxHEIGHT`.
pub(super) fn size(text: &str) -> Result<(usize, usize), String> {
    let number = |text: &str| text.parse().ok().filter(|n| (1..=LARGEST).contains(n));
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((number(w)?, number(h)?)));
    sides.ok_or_else(|| format!("expected WIDTHxHEIGHT, each from 1 to {LARGEST}"))
}

/// Draws and writes.
///
/// # Errors
/// A file that cannot be read or does not fit the mesh, or a place that is not writable.
pub fn run(args: &Args) -> Outcome {
    let mesh = mesh_source::load(&args.mesh)?.mesh;
    let vertices = mesh.positions().len();
    let field = args.field.as_deref().map(|path| Field::read(path, vertices, args.column)).transpose()?;
    let marked = match &args.constraints {
        Some(path) => table::read_constraints(path, vertices)?.vertices,
        None => Vec::new(),
    };
    let plain = Style::default().colouring;
    let style = Style {
        size: args.size,
        colouring: field.as_ref().map_or(plain, Field::colouring),
        marked_vertices: &marked,
        flat: args.flat,
        ..Style::default()
    };
    match &args.frames {
        None => draw(&mesh, &style, &args.camera(mesh.bounding_box())).write_png(&args.out)?,
        Some(path) => args.sequence(&mesh, &frames::read(path, &mesh)?, &style)?,
    }
    Ok(Exit::Ok)
}

impl Args {
    fn camera(&self, bounds: (Vector, Vector)) -> Camera {
        let camera = Camera::framing_box(bounds, self.view, self.up);
        if self.perspective { camera.perspective(5.0) } else { camera }
    }

    fn sequence(&self, mesh: &TriangleMesh, frames: &Frames, style: &Style<'_>) -> anyhow::Result<()> {
        const COLUMNS: usize = 8;
        let camera = self.camera(hull(frames));
        let picture = |k: usize| {
            let pose = mesh.with_positions(frames.frame(k).to_vec()).expect("frames are finite");
            draw(&pose, style, &camera)
        };
        if let Some(rate) = self.animate {
            let count = u32::try_from(frames.len()).context("too many frames")?;
            write_apng(count, rate, &self.out, |k| picture(k as usize))?;
            return Ok(());
        }
        let count = frames.len().min(self.pictures as usize);
        let pictures: Vec<Image> = (0..count).map(|i| picture(i * frames.len() / count)).collect();
        contact_sheet(&pictures, COLUMNS, 4, style.background)
            .context("the sheet is too large; lower --size or --pictures")?
            .write_png(&self.out)?;
        Ok(())
    }
}

/// The box around all frames, so that one camera sees the whole motion.
fn hull(frames: &Frames) -> (Vector, Vector) {
    let mut hull = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in frames.iter().flatten() {
        for i in 0..3 {
            hull.0[i] = hull.0[i].min(p[i]);
            hull.1[i] = hull.1[i].max(p[i]);
        }
    }
    hull
}

/// What colours the surface.
enum Field {
    Scalar(Vec<f64>),
    Rotation(Vec<[f64; 4]>),
}

impl Field {
    fn read(path: &Path, vertices: usize, column: Option<usize>) -> anyhow::Result<Self> {
        let is_npy = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy"));
        let read = if is_npy { npy::read_columns } else { table::read_columns };
        let (k, values) = read(path, vertices)?;
        match column {
            None if k == 4 => Ok(Self::Rotation(values.as_chunks().0.to_vec())),
            _ => {
                let column = column.unwrap_or(0);
                if column >= k {
                    bail!("{}: has {k} columns; --column counts from 0", path.display());
                }
                Ok(Self::Scalar(values.into_iter().skip(column).step_by(k).collect()))
            }
        }
    }

    fn colouring(&self) -> Colouring<'_> {
        match self {
            Self::Scalar(values) => Colouring::Scalar { values, range: None },
            Self::Rotation(quaternions) => Colouring::Rotation(quaternions),
        }
    }
}
