"""Points, rays and segments at a mesh: times and agreement of answers, with other libraries."""
