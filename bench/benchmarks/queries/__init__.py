"""Points, rays and segments at a mesh: time and agreement of answers, beside other libraries."""
