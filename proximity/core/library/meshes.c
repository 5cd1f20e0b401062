/* The bodies of a mesh, as a scene. */
#include "scene.h"

int proximity_from_mesh(const char *name, const double *vertices, size_t vertex_count, const int32_t *faces,
                        size_t face_count, proximity_scene **scene, proximity_error *error)
{
    (void)name, (void)vertices, (void)vertex_count, (void)faces, (void)face_count, (void)scene;
    return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "not yet");
}
