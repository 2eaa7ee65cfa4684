//! Every mesh of the data folder: the report agrees with figures measured by other programs.

use std::path::Path;

use lapbench::mesh_io::{self, Finding};
use lapbench::mesh_source::load;
use lapbench::subdivision::Subdivision;
use lapsolve::topology::Topology;
use tests::needs;

/// Triangles, vertices, components, boundary edges, boundary loops, zero-area triangles, non-manifold edges and
/// vertices, duplicate triangles, clashing edges, unreferenced vertices: from the tables in the data folder's README.
/// `heart_20k` alone differs from it: two of its vertices are on flat triangles only, hence unreferenced here.
const FIGURES: [(&str, [usize; 11]); 31] = [
    ("meshes/femur_8k.ply", [7_798, 3_897, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/smpl_woman_14k.ply", [13_776, 6_890, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/armadillo_29k.ply", [29_170, 14_587, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/man_35k.ply", [34_986, 17_495, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/laurana_50k.ply", [49_954, 27_861, 1, 302, 4, 0, 0, 0, 0, 0, 2_735]),
    ("meshes/face_52k.ply", [51_712, 25_905, 1, 96, 1, 0, 0, 0, 0, 0, 0]),
    ("meshes/bunny_69k.ply", [69_451, 34_834, 1, 223, 5, 0, 0, 0, 0, 0, 0]),
    ("meshes/nefertiti_70k.ply", [70_000, 35_002, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/elephant_85k.ply", [84_638, 42_321, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/horse_97k.ply", [96_966, 48_485, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/tower_holes_97k.ply", [97_374, 49_291, 1, 1_280, 38, 0, 0, 0, 0, 0, 0]),
    ("meshes/ogre_124k.ply", [124_008, 62_194, 44, 236, 12, 4, 0, 3, 0, 0, 0]),
    ("meshes/discobolus_202k.ply", [201_698, 100_843, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/igea_269k.ply", [268_686, 134_345, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/cortex_pial_lh_306k.ply", [305_782, 152_893, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("meshes/dragon_871k.ply", [871_414, 437_645, 151, 4_270, 407, 108, 0, 0, 0, 0, 0]),
    ("bad/anchor_8k.ply", [7_598, 3_793, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("bad/chair_13k.ply", [12_756, 3_186, 4, 0, 0, 0, 9_545, 0, 6_382, 0, 0]),
    ("bad/cheese_18k.ply", [17_786, 8_629, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("bad/heart_20k.ply", [19_602, 10_000, 1, 396, 1, 198, 0, 0, 0, 0, 2]),
    ("bad/human_vtk_35k.ply", [34_660, 17_665, 13, 694, 38, 0, 2, 6, 1, 0, 0]),
    ("bad/crank_35k.ply", [35_492, 17_724, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("bad/brain_37k.ply", [36_752, 18_844, 14, 920, 14, 0, 0, 4, 0, 0, 0]),
    ("bad/cycloidal_43k.ply", [43_368, 21_384, 100, 0, 0, 0, 242, 26, 0, 0, 0]),
    ("bad/counter_84k.ply", [83_750, 41_837, 6, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("bad/dragon_res2_203k.ply", [202_520, 100_250, 7, 0, 0, 0, 2_534, 16, 1_489, 0, 43]),
    ("sequences/horse_gallop.ply", [16_843, 8_431, 1, 19, 2, 0, 0, 0, 0, 0, 0]),
    ("sequences/horse.ply", [16_843, 8_431, 1, 19, 2, 0, 0, 0, 0, 0, 0]),
    ("sequences/samba.ply", [19_938, 9_971, 1, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("sequences/camel.ply", [43_814, 21_887, 1, 5, 2, 0, 26, 3, 14, 0, 0]),
    ("sequences/tosca_michael.ply", [105_032, 52_565, 1, 100, 3, 0, 0, 0, 0, 164, 0]),
];

fn found_in(path: &Path) -> [usize; 11] {
    let loaded = load(path.to_str().expect("the data folder has a plain name")).unwrap();
    let topology = loaded.topology;
    [
        loaded.mesh.triangles().len(),
        loaded.mesh.positions().len(),
        topology.components,
        topology.boundary_edges.count,
        topology.boundary_loops,
        topology.zero_area.count,
        topology.non_manifold_edges.count,
        topology.non_manifold_vertices.count,
        topology.duplicates.count,
        topology.clashing_edges.count,
        topology.unreferenced_vertices.count,
    ]
}

#[test]
fn reports_agree_with_published_figures() {
    let Some(data) = needs::data() else { return };
    for (name, expected) in FIGURES {
        assert_eq!(found_in(&data.join(name)), expected, "{name}");
    }
}

/// Every format that is written keeps every bit, so that the checksum of a mesh does not depend on its file.
#[test]
fn written_meshes_read_back_with_the_same_checksum() {
    let Some(data) = needs::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    for name in ["meshes/nefertiti_70k.ply", "bad/heart_20k.ply"] {
        let original = mesh_io::read_mesh(&data.join(name)).unwrap();
        for copy in ["copy.ply", "copy.obj"] {
            let path = folder.path().join(copy);
            mesh_io::write_mesh(&path, &original.mesh).unwrap();
            let copy = mesh_io::read_mesh(&path).unwrap();
            assert_eq!((copy.mesh, copy.sha256), (original.mesh.clone(), original.sha256), "{name}");
            assert_eq!(copy.notes, original.notes);
        }
    }
}

#[test]
fn frames_and_pairs_of_the_data_folder_are_read() {
    let Some(data) = needs::data() else { return };
    let sequences = data.join("sequences");
    for (file, mesh, frames, vertices) in [
        ("samba_frames.npy", "samba.ply", 156, 9_971),
        ("horse_gallop_frames.npy", "horse_gallop.ply", 48, 8_431),
        ("camel_poses.npy", "camel.ply", 10, 21_887),
    ] {
        let mesh = mesh_io::read_mesh(&sequences.join(mesh)).unwrap().mesh;
        let read = mesh_io::frames::read(&sequences.join(file), &mesh).unwrap();
        assert_eq!((read.len(), read.vertices()), (frames, vertices), "{file}");
    }
    let samba = mesh_io::read_mesh(&sequences.join("samba.ply")).unwrap();
    let frames = mesh_io::frames::read(&sequences.join("samba_frames.npy"), &samba.mesh).unwrap();
    assert_eq!(frames.frame(0), samba.mesh.positions());
    for (file, limits, pairs) in [
        ("horse_camel_tri_many.txt", [16_843, 43_814], 49_793),
        ("horse_camel_tri_one.txt", [16_843, 43_814], 43_814),
        ("horse_camel_markers.txt", [8_431, 21_887], 107),
    ] {
        let read = mesh_io::table::read_pairs(&sequences.join(file), limits).unwrap();
        assert_eq!(read.len(), pairs, "{file}");
    }
}

#[test]
fn a_wrong_extension_is_noted_and_does_no_harm() {
    let Some(data) = needs::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    for name in ["mesh.obj", "mesh.stl", "mesh.glb", "mesh.off"] {
        let path = folder.path().join(name);
        std::fs::copy(data.join("meshes/femur_8k.ply"), &path).unwrap();
        let loaded = mesh_io::read_mesh(&path).unwrap();
        assert_eq!(loaded.mesh.triangles().len(), 7_798);
        assert_eq!(loaded.notes[0].finding, Finding::OtherExtension);
    }
}

#[test]
fn samba_twice_subdivided_is_closed_smooth_and_its_frames_follow() {
    let Some(data) = needs::data() else { return };
    let samba = mesh_io::read_mesh(&data.join("sequences/samba.ply")).unwrap().mesh;
    let frames = mesh_io::frames::read(&data.join("sequences/samba_frames.npy"), &samba).unwrap();
    let fine = Subdivision::new(&samba, 2).unwrap();
    assert_eq!((fine.mesh().triangles().len(), fine.mesh().positions().len()), (319_008, 159_506));
    let topology = Topology::of(fine.mesh());
    assert!(topology.is_closed() && topology.is_manifold());
    assert_eq!((topology.components, topology.clashing_edges.count), (1, 0));
    assert_eq!(fine.apply(frames.frame(0)), fine.mesh().positions());
    // The centre of mass of the vertices moves with the dancer, whatever the number of vertices.
    let mean = |p: &[[f64; 3]]| p.iter().map(|p| p[1]).sum::<f64>() / p.len() as f64;
    let moved = fine.apply(frames.frame(80));
    assert!((mean(&moved) - mean(frames.frame(80))).abs() < 0.02 * samba.diagonal());
}
