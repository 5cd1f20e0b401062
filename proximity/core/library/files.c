/* A file in memory: mapped copy-on-write if the system can, read otherwise. */
#include "core.h"

#include <errno.h>
#include <string.h>

#if defined(_WIN32)

#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <windows.h>

static FILE *opened(const char *path)
{
    wchar_t wide[32768];
    int count = MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, wide, 32768);
    return count > 0 ? _wfopen(wide, L"rb") : NULL;
}

int proximity_map_file(const char *path, uint8_t **bytes, size_t *size, proximity_error *error)
{
    FILE *file = opened(path);
    int64_t end = file != NULL && _fseeki64(file, 0, SEEK_END) == 0 ? _ftelli64(file) : -1;
    *bytes = end > 0 && _fseeki64(file, 0, SEEK_SET) == 0 ? _aligned_malloc((size_t)end, PAGE) : NULL;
    *size = (size_t)end;
    int is_read = *bytes != NULL && fread(*bytes, 1, *size, file) == *size;
    if (file != NULL) {
        fclose(file);
    }
    if (!is_read) {
        _aligned_free(*bytes);
        return proximity_refuse(error, PROXIMITY_NO_FILE, "%s: it cannot be opened, or is empty", path);
    }
    return PROXIMITY_OK;
}

void proximity_unmap(uint8_t *bytes, size_t size)
{
    (void)size;
    _aligned_free(bytes);
}

#elif defined(__wasm__)

int proximity_map_file(const char *path, uint8_t **bytes, size_t *size, proximity_error *error)
{
    *bytes = NULL;
    *size = 0;
    return proximity_refuse(error, PROXIMITY_NO_FILE, "%s: there are no files here", path);
}

void proximity_unmap(uint8_t *bytes, size_t size)
{
    (void)bytes;
    (void)size;
}

#else

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

int proximity_map_file(const char *path, uint8_t **bytes, size_t *size, proximity_error *error)
{
    struct stat status;
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0 || fstat(file, &status) != 0) {
        int code = proximity_refuse(error, PROXIMITY_NO_FILE, "%s: it cannot be opened (%s)", path, strerror(errno));
        if (file >= 0) {
            close(file);
        }
        return code;
    }
    *size = (size_t)status.st_size;
    *bytes = NULL;
    if (S_ISREG(status.st_mode) && *size > 0) {
        void *mapped = mmap(NULL, *size, PROT_READ | PROT_WRITE, MAP_PRIVATE, file, 0);
        *bytes = mapped == MAP_FAILED ? NULL : mapped;
    }
    close(file);
    if (*bytes == NULL) {
        return proximity_refuse(error, PROXIMITY_NO_FILE, "%s: it is no regular file, is empty, or cannot be mapped",
                                path);
    }
    return PROXIMITY_OK;
}

void proximity_unmap(uint8_t *bytes, size_t size)
{
    munmap(bytes, size);
}

#endif
