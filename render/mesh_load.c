/* Reading mesh files through Assimp. */
#include "render/mesh.h"

#include "render/mesh_file.h"

#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

struct totals {
    size_t vertices, triangles;
    bool with_uv; /* of every mesh in the file */
};

static struct totals count(const struct aiScene *scene)
{
    struct totals totals = {.with_uv = true};
    for (unsigned m = 0; m < scene->mNumMeshes; m++) {
        const struct aiMesh *part = scene->mMeshes[m];
        if (part->mPrimitiveTypes & aiPrimitiveType_TRIANGLE) {
            totals.vertices += part->mNumVertices;
            totals.triangles += part->mNumFaces;
            totals.with_uv = totals.with_uv && part->mTextureCoords[0];
        }
    }
    return totals;
}

static void copy_part(const struct aiMesh *part, size_t first, size_t *triangles, struct mesh *mesh)
{
    for (unsigned i = 0; i < part->mNumVertices; i++) {
        const struct aiVector3D *p = &part->mVertices[i];
        mesh->positions[first + i][0] = p->x;
        mesh->positions[first + i][1] = p->y;
        mesh->positions[first + i][2] = p->z;
        if (part->mNormals) {
            mesh->normals[first + i][0] = part->mNormals[i].x;
            mesh->normals[first + i][1] = part->mNormals[i].y;
            mesh->normals[first + i][2] = part->mNormals[i].z;
        }
        if (mesh->uv) {
            mesh->uv[first + i][0] = part->mTextureCoords[0][i].x;
            mesh->uv[first + i][1] = part->mTextureCoords[0][i].y;
        }
    }
    for (unsigned i = 0; i < part->mNumFaces; i++) {
        const struct aiFace *face = &part->mFaces[i];
        if (face->mNumIndices == 3) {
            for (int k = 0; k < 3; k++) {
                mesh->triangles[*triangles][k] = (uint32_t)(first + face->mIndices[k]);
            }
            (*triangles)++;
        }
    }
}

/* Read a file and have its faces made triangles. NULL: *error tells. */
static const struct aiScene *import(const char *path, struct nacre_error *error)
{
    /* Without a look at the indices first, the other steps crash on files that lie. */
    const struct aiScene *scene = aiImportFile(path, aiProcess_ValidateDataStructure);
    for (unsigned m = 0; scene && m < scene->mNumMeshes; m++) {
        const struct aiMesh *part = scene->mMeshes[m];
        for (unsigned i = 0; i < part->mNumFaces; i++) {
            if (part->mFaces[i].mNumIndices == 0) { /* at which triangulating aborts */
                (void)nacre_fail(error, "%s: face %u has no corners; repair the mesh", path, i);
                aiReleaseImport(scene);
                return NULL;
            }
        }
    }
    if (scene) {
        scene = aiApplyPostProcessing(
            scene, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices | aiProcess_SortByPType |
                       aiProcess_PreTransformVertices | aiProcess_GenSmoothNormals);
    }
    if (!scene) {
        (void)nacre_fail(error, "%s: cannot read the mesh: %s", path, aiGetErrorString());
    }
    return scene;
}

int mesh_load(const char *path, struct mesh *mesh, struct nacre_error *error)
{
    int status = NACRE_FAILED;
    size_t vertices = 0, triangles = 0;
    const struct aiScene *scene = NULL;
    *mesh = (struct mesh){0};
    if (mesh_file_check(path, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    scene = import(path, error);
    if (!scene) {
        goto out;
    }
    struct totals totals = count(scene);
    if (totals.triangles == 0) {
        (void)nacre_fail(error, "%s: the mesh has no triangles", path);
        goto out;
    }
    if (mesh_allocate(mesh, totals.vertices, totals.triangles, totals.with_uv, error) != NACRE_OK) {
        (void)nacre_fail_within(error, "%s", path);
        goto out;
    }
    for (unsigned m = 0; m < scene->mNumMeshes; m++) {
        if (scene->mMeshes[m]->mPrimitiveTypes & aiPrimitiveType_TRIANGLE) {
            copy_part(scene->mMeshes[m], vertices, &triangles, mesh);
            vertices += scene->mMeshes[m]->mNumVertices;
        }
    }
    mesh->triangle_count = triangles;
    status = mesh_check(mesh, path, error);
out:
    if (status != NACRE_OK) {
        mesh_finish(mesh);
    }
    if (scene) {
        aiReleaseImport(scene);
    }
    return status;
}
