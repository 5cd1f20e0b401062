/* The part of numba's runtime that compiled kernels use: reference-counted memory of arrays, and two
   functions of C under its names. */
#include "entry_points.h"

#include <math.h>
#include <stdlib.h>

void *NRT_MemInfo_alloc_aligned(uint64_t size, uint32_t align)
{
    /* One block: the owner, a gap, and the data at an address that is a multiple of `align`. */
    if (size > SIZE_MAX - sizeof(Owner) - align) {
        return NULL;
    }
    Owner *owner = malloc(sizeof(Owner) + (size_t)size + align);
    if (owner == NULL) {
        return NULL;
    }
    uintptr_t after = (uintptr_t)(owner + 1);
    owner->references = 1;
    owner->data = (void *)((after + align - 1) / align * align);
    owner->size = size;
    return owner;
}

void NRT_MemInfo_call_dtor(void *owner)
{
    free(owner);
}

void release_owner(Owner *owner)
{
    if (__atomic_sub_fetch(&owner->references, 1, __ATOMIC_ACQ_REL) == 0) {
        free(owner);
    }
}

double numba_frexp(double value, int *exponent)
{
    return frexp(value, exponent);
}

double numba_ldexp(double value, int exponent)
{
    return ldexp(value, exponent);
}
