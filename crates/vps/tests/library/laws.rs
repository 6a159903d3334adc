//! What keys of a scene change of a force, a query can have as well.

use std::ops::ControlFlow;

use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::part::Part;
use vps::{ContactQuery, DVec3, Error, FieldKind, Mesh, Options, PointShell, Points, Pose, Voxmap};

use super::{block, cube, poses};

const GO_ON: fn(vps::BakeStage) -> ControlFlow<()> = |_| ControlFlow::Continue(());

/// A scene bakes parts by [`Part`] and sums by the specification over them.
fn scene(mesh: &Mesh, options: &Options, with_gradients: bool) -> Obstacle {
    let part = Part::new("part", mesh_of(mesh));
    let (field, _) = part.bake_field(options, with_gradients, |_| ()).unwrap();
    Obstacle { field, world_from_map: Pose::IDENTITY }
}

fn mesh_of(mesh: &Mesh) -> vps::mesh::TriangleMesh {
    vps::mesh::TriangleMesh {
        vertices: mesh.vertices().to_vec(),
        triangles: mesh.triangles().to_vec(),
    }
}

#[test]
fn a_query_with_the_keys_of_a_scene_has_its_force() {
    let options = Options { layers: 6, ..Options::new(0.7e-3) };
    let tool_options = Options::new(0.6e-3);
    let tool_mesh = super::ball();
    let stiffness_n_per_m = 20e9 * tool_options.voxel_size_m.powi(2);
    let mut differ = 0;
    let mut touching = 0;
    for points in [Points::Facets, Points::Voxels] {
        let shell = PointShell::bake_of(&tool_mesh, &tool_options, points, GO_ON).unwrap();
        let part = Part::new("tool", mesh_of(&tool_mesh));
        let (of_scene, mass, _) = part.bake_shell(&tool_options, points, None, |_| ()).unwrap();
        for (_, field) in FieldKind::NAMES {
            let with_gradients = field == FieldKind::SurfacePoint;
            let obstacles = [scene(&block(), &options, with_gradients)];
            let voxmap = Voxmap::bake_for(&block(), &options, field, GO_ON).unwrap();
            let plain = ContactQuery::new(&voxmap, &shell, stiffness_n_per_m).unwrap();
            let mut query = ContactQuery::new(&voxmap, &shell, stiffness_n_per_m).unwrap();
            query.set_field(field).unwrap();
            for pose in poses(40) {
                let body = pose * Pose::from_translation(mass.center_m);
                let law = ForceLaw { field, stiffness_n_per_m, ..ForceLaw::PLAIN };
                let sum = ContactSum::flat(&obstacles, &of_scene, body, law);
                let felt = query.wrench(pose).unwrap();
                assert_eq!(felt.wrench, sum.wrench.moved(body.translation, pose.translation));
                assert_eq!(felt.contacts, sum.contacts);
                let mut force_n = DVec3::ZERO;
                query.contacts(pose, |contact| force_n += contact.force_n).unwrap();
                let size_n = felt.wrench.force.length();
                assert!((force_n - felt.wrench.force).length() <= 1e-4 * size_n, "{felt:?}");
                let other = plain.wrench(pose).unwrap();
                differ += u32::from(other.wrench != felt.wrench);
                touching += u32::from(size_n > 0.0);
            }
        }
    }
    // All but those that are trilinear themselves.
    assert!(touching > 100 && 2 * differ > touching, "{differ} differ of {touching}");
    let voxmap = Voxmap::bake(&block(), &options).unwrap();
    let mut query = ContactQuery::new(&voxmap, &cube(), 1000.0).unwrap();
    let refused = query.set_field(FieldKind::SurfacePoint).unwrap_err();
    assert!(matches!(refused, Error::Field) && refused.to_string().contains("bake them for"));
}
