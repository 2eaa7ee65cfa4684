use super::*;

/// Buffer 0: four f32 corners of a square (48 bytes), then the u16 indices 0 1 2 0 2 3 (12), then u8 0 1 3 2 (4).
fn buffer() -> Vec<u8> {
    let corners = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    let mut bytes: Vec<u8> = corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend([0, 1, 3, 2]);
    bytes
}

/// A document over that buffer with the given `meshes`, `nodes` and buffer location.
fn document(meshes: &str, nodes: &str, location: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"meshes":{meshes},"nodes":{nodes},
        "buffers":[{{"byteLength":64{location}}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":16}}],
        "accessors":[
        {{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
        {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}},
        {{"bufferView":1,"byteOffset":12,"componentType":5121,"count":4,"type":"SCALAR"}}]}}"#
    )
}

fn embedded() -> String {
    format!(r#","uri":"data:application/octet-stream;base64,{}""#, STANDARD.encode(buffer()))
}

fn glb(json: &str) -> Vec<u8> {
    let (mut json, bin) = (json.as_bytes().to_vec(), buffer());
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = (28 + json.len() + bin.len()) as u32;
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes(), kind, data].concat();
    [b"glTF", &2u32.to_le_bytes()[..], &length.to_le_bytes(), &chunk(b"JSON", &json), &chunk(b"BIN\0", &bin)]
        .concat()
}

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

const SQUARE: &str = r#"[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]"#;
const ONE_NODE: &str = r#"[{"mesh":0}]"#;

#[test]
fn buffers_inside_beside_and_binary() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a b.bin"), buffer()).unwrap();
    let beside = document(SQUARE, ONE_NODE, r#","uri":"a%20b.bin""#);
    let inside = document(SQUARE, ONE_NODE, &embedded());
    let binary = glb(&document(SQUARE, ONE_NODE, ""));
    for (bytes, folder) in
        [(beside.as_bytes(), Some(folder.path())), (inside.as_bytes(), None), (binary.as_slice(), None)]
    {
        let (mesh, notes) = parse(bytes, folder).unwrap();
        assert_eq!(mesh.positions(), [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(notes, []);
    }
    assert!(parse(beside.as_bytes(), None).unwrap_err().to_string().contains("outside of the folder"));
    for uri in ["../a.bin", "/etc/passwd", "file:///etc/passwd", "https://example.org/a.bin", "%2e%2e/a.bin"]
    {
        let document = document(SQUARE, ONE_NODE, &format!(r#","uri":"{uri}""#));
        let fault = parse(document.as_bytes(), Some(folder.path())).unwrap_err();
        assert!(fault.to_string().contains("outside of the folder"), "{fault}");
    }
    assert!((0..binary.len()).all(|length| parse(&binary[..length], None).is_err()));
}

#[test]
fn instances_transforms_mirrors_and_strips() {
    let meshes = r#"[{"primitives":[{"attributes":{"POSITION":0},"indices":2,"mode":5},
        {"attributes":{"POSITION":0},"mode":6},{"attributes":{"POSITION":0},"mode":1}]}]"#;
    let nodes = r#"[{"translation":[10,0,0],"children":[1,2]},{"mesh":0,"scale":[2,2,-2]},
        {"mesh":0,"rotation":[0,0,0.70710678,0.70710678],"children":[3]},{"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,5,1],"mesh":0}]"#;
    let (mesh, notes) = parse(document(meshes, nodes, &embedded()).as_bytes(), None).unwrap();
    // Each node: the strip 0 1 3 2 gives (0 1 3) (1 2 3), the fan 0 1 2 3 gives (1 2 0) (2 3 0); node 1 is mirrored.
    assert_eq!(mesh.triangles()[..4], [[0, 3, 1], [1, 3, 2], [1, 0, 2], [2, 0, 3]]);
    assert_eq!(mesh.triangles()[4..8], [[4, 5, 7], [5, 6, 7], [5, 6, 4], [6, 7, 4]]);
    let expected = [[10.0, 0.0, 0.0], [12.0, 0.0, 0.0], [12.0, 2.0, 0.0], [10.0, 2.0, 0.0]];
    assert_eq!(mesh.positions()[..4], expected);
    let turned = [[10.0, 0.0, 0.0], [10.0, 1.0, 0.0], [9.0, 1.0, 0.0], [9.0, 0.0, 0.0]];
    for k in 0..4 {
        for i in 0..3 {
            let depth = if i == 2 { 5.0 } else { 0.0 };
            assert!((mesh.positions()[4 + k][i] - turned[k][i]).abs() < 1e-15);
            assert!((mesh.positions()[8 + k][i] - turned[k][i] - depth).abs() < 1e-15);
        }
    }
    let found: Vec<_> = notes.iter().map(|note| (note.finding, note.count)).collect();
    assert_eq!(found, [(Finding::OtherPrimitives, 3), (Finding::RepeatedPositions, 12)]);
}

#[test]
fn inconsistent_documents_are_errors() {
    let good = document(SQUARE, ONE_NODE, &embedded());
    for (from, to, part) in [
        (r#""count":4,"type":"VEC3""#, r#""count":4000000000,"type":"VEC3""#, "outside of its buffer"),
        (r#""count":6"#, r#""count":9"#, "outside of its buffer"),
        (
            r#""byteOffset":48,"byteLength":16"#,
            r#""byteOffset":18446744073709551615,"byteLength":16"#,
            "outside",
        ),
        (r#""byteLength":64"#, r#""byteLength":65"#, "promised are 65"),
        ("base64,AAAA", "base64,AA-A", "base64"),
        (r#"{"mesh":0}"#, r#"{"mesh":0,"children":[0]}"#, "reached twice"),
        (r#"{"mesh":0}"#, r#"{"mesh":7}"#, "no valid glTF"),
        (r#""componentType":5123"#, r#""componentType":5126"#, "unsigned"),
        (r#""POSITION":0"#, r#""NORMAL":0"#, "POSITION"),
        (r#""indices":1"#, r#""mode":1"#, "no triangles"),
        (r#""componentType":5126"#, r#""componentType":5125"#, "three floats"),
        (
            r#"{"version":"2.0"}"#,
            r#"{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]"#,
            "glTF",
        ),
    ] {
        let fault = parse(good.replacen(from, to, 1).as_bytes(), None).unwrap_err();
        assert!(fault.to_string().contains(part), "{from} -> {to}: {fault}");
    }
    let nested = format!(r#"{{"asset":{{"version":"2.0"}},"extras":{}"#, "[".repeat(100_000));
    assert!(parse(nested.as_bytes(), None).is_err());
}

#[test]
fn a_bomb_of_instances_is_stopped() {
    let nodes: Vec<String> = (1..200_000).map(|_| String::from(r#"{"mesh":0}"#)).collect();
    let children: Vec<String> = (1..200_000).map(|i| i.to_string()).collect();
    let nodes = format!(r#"[{{"children":[{}]}},{}]"#, children.join(","), nodes.join(","));
    let primitive = r#"{"attributes":{"POSITION":0},"indices":1}"#;
    let meshes = format!(r#"[{{"primitives":[{}]}}]"#, vec![primitive; 100].join(","));
    let fault = parse(document(&meshes, &nodes, &embedded()).as_bytes(), None).unwrap_err();
    assert!(fault.to_string().contains("instances included"), "{fault}");
}

/// A square of which the upper half follows a joint that turns by a right angle about z within half a second, while a morph
/// target raises the whole and a node carries it along x. Keys are sparse: 0 and 0.5 s.
fn animated() -> (String, Vec<u8>) {
    let mut bytes = buffer();
    let mut starts = Vec::new();
    let mut add = |numbers: &[f32]| {
        starts.push(bytes.len());
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    };
    add(&[0.0, 0.5]); // 0 times
    let h = std::f32::consts::FRAC_1_SQRT_2;
    add(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, h, h]); // 1 rotations
    add(&[0.0, 1.0]); // 2 weights
    add(&[0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0, 0.0, 3.0]); // 3 target
    add(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]); // 4 weights of joints
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut back = identity;
    back[13] = -1.0; // the second joint stands at (0, 1, 0)
    add(&[identity, back].concat()); // 5 inverse bind matrices
    starts.push(bytes.len());
    bytes.extend([0, 1, 0, 0].repeat(4)); // 6 joints of the weights
    let view = |k: usize| {
        let end = starts.get(k + 1).copied().unwrap_or(bytes.len());
        format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, starts[k], end - starts[k])
    };
    let views: Vec<String> = (0..7).map(view).collect();
    let float = |view: usize, count: usize, kind: &str| {
        format!(r#"{{"bufferView":{},"componentType":5126,"count":{count},"type":"{kind}"}}"#, view + 2)
    };
    let accessors = [
        float(0, 2, r#"SCALAR","min":[0],"max":[0.5],"name":"t"#),
        float(1, 2, "VEC4"),
        float(2, 2, "SCALAR"),
        float(3, 4, r#"VEC3","min":[0,0,3],"max":[0,0,3],"name":"d"#),
        float(4, 4, "VEC4"),
        float(5, 2, "MAT4"),
        r#"{"bufferView":8,"componentType":5121,"count":4,"type":"VEC4"}"#.to_owned(),
    ];
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
        "nodes":[{{"mesh":0,"skin":0}},{{"children":[2]}},{{"translation":[0,1,0]}}],
        "skins":[{{"joints":[1,2],"inverseBindMatrices":8}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"JOINTS_0":9,"WEIGHTS_0":7}},"indices":1,
            "targets":[{{"POSITION":6}}]}}]}}],
        "animations":[{{"samplers":[{{"input":3,"output":4}},{{"input":3,"output":5}}],"channels":[
            {{"sampler":0,"target":{{"node":2,"path":"rotation"}}}},{{"sampler":1,"target":{{"node":0,"path":"weights"}}}}]}}],
        "buffers":[{{"byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":16}},{}],
        "accessors":[
        {{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
        {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}},
        {{"bufferView":1,"byteOffset":12,"componentType":5121,"count":4,"type":"SCALAR"}},{}]}}"#,
        bytes.len(),
        views.join(","),
        accessors.join(",")
    );
    (json, bytes)
}

fn animated_glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = (28 + json.len() + bin.len()) as u32;
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes(), kind, data].concat();
    [b"glTF", &2u32.to_le_bytes()[..], &length.to_le_bytes(), &chunk(b"JSON", &json), &chunk(b"BIN\0", bin)]
        .concat()
}

#[test]
fn skins_morph_targets_and_turning_nodes_move_the_vertices() {
    let (json, bytes) = animated();
    let file = animated_glb(&json, &bytes);
    let (mesh, _) = parse(&file, None).unwrap();
    let (frames, rate) = parse_animation(&file, None).unwrap();
    assert_eq!((frames.len(), rate, frames.vertices()), (16, 30.0, 4));
    assert_eq!(frames.frame(0), mesh.positions());
    let last = frames.frame(15);
    // Corners (0,0) (1,0) stay below; (1,1) (0,1) turn about (0,1): (1,1) -> (0,2). All rise by 3.
    for (p, expected) in last.iter().zip([[0.0, 0.0, 3.0], [1.0, 0.0, 3.0], [0.0, 2.0, 3.0], [0.0, 1.0, 3.0]])
    {
        assert!(p.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{last:?}");
    }
    let middle = frames.frame(7); // 7/30 s of 1/2 s: 42 degrees
    let (sin, cos) = 42f64.to_radians().sin_cos();
    assert!((middle[2][0] - cos).abs() < 1e-6 && (middle[2][1] - 1.0 - sin).abs() < 1e-6, "{middle:?}");
    for (from, to, part) in [
        (r#""animations""#, r#""other""#, "no animation"),
        (r#"{"input":3,"output":4}"#, r#"{"input":4,"output":4}"#, ""),
        (r#"{"input":3,"output":4}"#, r#"{"input":3,"output":5}"#, ""),
        (r#""joints":[1,2]"#, r#""joints":[1]"#, "a joint its skin does not have"),
        (r#""count":2,"type":"MAT4""#, r#""count":1,"type":"MAT4""#, "fewer bind matrices"),
    ] {
        assert!(json.contains(from), "{from}");
        let fault = parse_animation(&animated_glb(&json.replacen(from, to, 1), &bytes), None).unwrap_err();
        assert!(fault.to_string().contains(part), "{from}: {fault}");
    }
    assert!((0..file.len()).step_by(7).all(|length| parse_animation(&file[..length], None).is_err()));
}
