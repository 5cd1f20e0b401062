/* The bytes of a compiled scene: kernels verify header and checksums; this file reads the layout, the table
   of arrays and the names of parts from its JSON description. */
#include "core.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    const char *at, *end;
} Text;

/* --- JSON: functions return 0 for invalid text ------------------------------------------------------- */

static int is_one_of(const char *characters, char character)
{
    return character != '\0' && strchr(characters, character) != NULL;
}

static void skip_space(Text *text)
{
    while (text->at < text->end && is_one_of(" \t\r\n", *text->at)) {
        text->at++;
    }
}

static int take(Text *text, char expected)
{
    skip_space(text);
    if (text->at < text->end && *text->at == expected) {
        text->at++;
        return 1;
    }
    return 0;
}

/* The contents of a string, with its escapes. */
static int read_string(Text *text, Text *inside)
{
    if (!take(text, '"')) {
        return 0;
    }
    inside->at = text->at;
    while (text->at < text->end && *text->at != '"') {
        text->at += *text->at == '\\' ? 2 : 1;
    }
    if (text->at >= text->end) {
        return 0;
    }
    inside->end = text->at++;
    return 1;
}

/* The text of any value; only its brackets and strings are parsed. */
static int read_value(Text *text, Text *value)
{
    Text inside;
    int64_t depth = 0;
    skip_space(text);
    value->at = text->at;
    do {
        skip_space(text);
        if (text->at >= text->end) {
            return 0;
        }
        if (*text->at == '"') {
            if (!read_string(text, &inside)) {
                return 0;
            }
        } else if (is_one_of("[{", *text->at)) {
            depth++;
            text->at++;
        } else if (is_one_of("]}", *text->at)) {
            depth--;
            text->at++;
        } else if (depth > 0 && is_one_of(",:", *text->at)) {
            text->at++;
        } else {
            const char *begin = text->at;
            while (text->at < text->end && !is_one_of(" \t\r\n,:\"[]{}", *text->at)) {
                text->at++;
            }
            if (text->at == begin) {
                return 0;
            }
        }
    } while (depth > 0);
    value->end = text->at;
    return depth == 0;
}

/* The value of a key of an object. */
static int find(Text object, const char *key, Text *value)
{
    Text name;
    if (!take(&object, '{')) {
        return 0;
    }
    do {
        if (!read_string(&object, &name) || !take(&object, ':') || !read_value(&object, value)) {
            return 0;
        }
        if ((size_t)(name.end - name.at) == strlen(key) && memcmp(name.at, key, strlen(key)) == 0) {
            return 1;
        }
    } while (take(&object, ','));
    return 0;
}

enum { MAX_DIGITS = 18 }; /* fit into 64 bits */

static int read_whole(Text *text, int64_t *number)
{
    int is_negative = take(text, '-'), digits = 0;
    *number = 0;
    skip_space(text);
    for (; text->at < text->end && *text->at >= '0' && *text->at <= '9'; text->at++, digits++) {
        *number = digits < MAX_DIGITS ? 10 * *number + (*text->at - '0') : *number;
    }
    *number = is_negative ? -*number : *number;
    return digits > 0 && digits <= MAX_DIGITS;
}

static int find_whole(Text object, const char *key, int64_t *number)
{
    Text value;
    return find(object, key, &value) && read_whole(&value, number);
}

static int is_text(Text quoted, const char *expected)
{
    Text inside;
    size_t length = strlen(expected);
    return read_string(&quoted, &inside) && (size_t)(inside.end - inside.at) == length &&
           memcmp(inside.at, expected, length) == 0;
}

/* --- names -------------------------------------------------------------------------------------------- */

static int32_t hexadecimal(const char *at, const char *end)
{
    int32_t number = 0;
    for (int k = 0; k < 4; k++) {
        const char *digits = "0123456789abcdef", *found;
        char digit = at + k < end ? at[k] : '?';
        found = strchr(digits, digit >= 'A' && digit <= 'F' ? digit - 'A' + 'a' : digit);
        if (found == NULL || digit == '\0') {
            return -1;
        }
        number = 16 * number + (int32_t)(found - digits);
    }
    return number;
}

static char *write_utf8(char *to, int32_t code)
{
    if (code < 0x80 && code > 0) { /* a zero, which would terminate the name, takes two bytes */
        *to++ = (char)code;
        return to;
    }
    if (code >= 0x10000) {
        *to++ = (char)(0xF0 | code >> 18);
        *to++ = (char)(0x80 | (code >> 12 & 0x3F));
    } else if (code >= 0x800) {
        *to++ = (char)(0xE0 | code >> 12);
    } else {
        *to++ = (char)(0xC0 | code >> 6);
    }
    if (code >= 0x800) {
        *to++ = (char)(0x80 | (code >> 6 & 0x3F));
    }
    *to++ = (char)(0x80 | (code & 0x3F));
    return to;
}

/* Write a string without its escapes, terminated by a zero; it does not become longer. NULL if it is invalid. */
static char *write_name(Text inside, char *to)
{
    static const char escapes[] = "\"\\/bfnrt", meant[] = "\"\\/\b\f\n\r\t";
    while (inside.at < inside.end) {
        if (*inside.at != '\\') {
            *to++ = *inside.at++;
            continue;
        }
        const char *escape = inside.at + 1 < inside.end ? strchr(escapes, inside.at[1]) : NULL;
        if (escape != NULL && *escape != '\0') {
            *to++ = meant[escape - escapes];
            inside.at += 2;
            continue;
        }
        int32_t code = inside.at + 1 < inside.end && inside.at[1] == 'u' ? hexadecimal(inside.at + 2, inside.end) : -1;
        if (code < 0) {
            return NULL;
        }
        inside.at += 6;
        if (code >= 0xD800 && code < 0xDC00 && inside.end - inside.at >= 6 && inside.at[0] == '\\' &&
            inside.at[1] == 'u') {
            int32_t low = hexadecimal(inside.at + 2, inside.end);
            if (low >= 0xDC00 && low < 0xE000) {
                code = 0x10000 + ((code - 0xD800) << 10) + (low - 0xDC00);
                inside.at += 6;
            }
        }
        to = write_utf8(to, code);
    }
    *to++ = '\0';
    return to;
}

/* Read the names of parts; they take at most the space of their text. */
static int read_names(Text list, Archive *archive)
{
    Text name;
    char *to = archive->names = malloc((size_t)(list.end - list.at) + 1);
    if (to == NULL || !take(&list, '[')) {
        return to == NULL ? PROXIMITY_NO_MEMORY : PROXIMITY_BAD_FILE;
    }
    for (archive->part_count = 0; archive->part_count == 0 || take(&list, ','); archive->part_count++) {
        to = read_string(&list, &name) ? write_name(name, to) : NULL;
        if (to == NULL) {
            return PROXIMITY_BAD_FILE;
        }
    }
    return take(&list, ']') ? PROXIMITY_OK : PROXIMITY_BAD_FILE;
}

/* --- arrays ------------------------------------------------------------------------------------------- */

enum { MAX_ARRAYS = 64, LENGTHS = 2 };

typedef struct {
    Text name;
    int64_t lengths[LENGTHS], axes;
    int is_real, item_bytes;
} Shape;

static int read_shape(Text entry, Shape *shape, int64_t *row)
{
    Text type, lengths;
    if (!find(entry, "name", &shape->name) || !find(entry, "dtype", &type) || !find(entry, "shape", &lengths) ||
        !find_whole(entry, "offset", &row[0]) || !find_whole(entry, "checksum", &row[2]) || !take(&lengths, '[')) {
        return 0;
    }
    shape->is_real = is_text(type, "float64") || is_text(type, "float32");
    shape->item_bytes = is_text(type, "float64") || is_text(type, "int64")   ? 8
                        : is_text(type, "float32") || is_text(type, "int32") ? 4
                                                                             : 0;
    int64_t count = 1;
    for (shape->axes = 0; shape->axes == 0 || take(&lengths, ','); shape->axes++) {
        int64_t length;
        if (shape->axes == LENGTHS || !read_whole(&lengths, &length) || length < 0 ||
            (length > 0 && count > (INT64_C(1) << 56) / length)) {
            return 0;
        }
        shape->lengths[shape->axes] = length;
        count *= length;
    }
    row[1] = shape->item_bytes ? count * shape->item_bytes : -1;
    return take(&lengths, ']');
}

/* The rows of the array of that name; -1 if it does not match. */
static int64_t array_of(const Shape *shapes, int64_t count, int64_t table[][3], uint8_t *data, const char *name,
                        int item_bytes, int is_real, int64_t columns, void *array)
{
    for (int64_t k = 0; k < count; k++) {
        const Shape *shape = &shapes[k];
        if (is_text(shape->name, name)) {
            int is_right = shape->item_bytes == item_bytes && shape->is_real == is_real &&
                           shape->axes == (columns ? 2 : 1) && (columns == 0 || shape->lengths[1] == columns);
            void *found = data + table[k][0];
            memcpy(array, &found, sizeof found);
            return is_right ? shape->lengths[0] : -1;
        }
    }
    return -1;
}

static int read_arrays(const InstructionSet *set, Text list, uint8_t *data, int64_t size, Archive *archive,
                       proximity_error *error)
{
    static const char not_understood[] = "its description cannot be understood; save the scene again with this version";
    Shape shapes[MAX_ARRAYS];
    int64_t table[MAX_ARRAYS][3], fault[FAULT_SIZE] = {0}, count = 0;
    Text entry;
    if (!take(&list, '[')) {
        return proximity_refuse(error, PROXIMITY_BAD_FILE, not_understood);
    }
    do {
        if (count == MAX_ARRAYS || !read_value(&list, &entry) || !read_shape(entry, &shapes[count], table[count])) {
            return proximity_refuse(error, PROXIMITY_BAD_FILE, not_understood);
        }
        count++;
    } while (take(&list, ','));
    int64_t words[] = {(int64_t)(intptr_t)data, size, (int64_t)(intptr_t)table, count, 3,
                       (int64_t)(intptr_t)fault, FAULT_SIZE, 0};
    if (!proximity_call(set, FAULT_IN_ARRAYS, words)) {
        return proximity_no_memory(error, "to look at the file");
    }
    if (words[7] != SOUND) {
        Text name = shapes[fault[0]].name;
        char told[40] = "";
        size_t length = name.end - name.at > 2 ? (size_t)(name.end - name.at - 2) : 0;
        memcpy(told, name.at + 1, length < sizeof told ? length : sizeof told - 1);
        return proximity_refuse_kind(error, words[7], fault, told, NULL);
    }
    archive->real_count = array_of(shapes, count, table, data, "reals", 8, 1, 0, &archive->reals);
    archive->word_count = array_of(shapes, count, table, data, "words", 4, 1, 0, &archive->words);
    archive->frame_count = array_of(shapes, count, table, data, "frames", 8, 1, FRAME_COLUMNS, &archive->frames);
    archive->part_rows = array_of(shapes, count, table, data, "parts", 8, 0, PART_COLUMNS, &archive->parts);
    if (archive->real_count < 0 || archive->word_count < 0 || archive->frame_count < 0 || archive->part_rows < 0) {
        return proximity_refuse(error, PROXIMITY_BAD_FILE, "its arrays are not those of a compiled scene");
    }
    return PROXIMITY_OK;
}

int proximity_read_archive(const InstructionSet *set, uint8_t *bytes, size_t size, Archive *archive,
                           proximity_error *error)
{
    int64_t fault[FAULT_SIZE] = {0};
    int64_t words[] = {(int64_t)(intptr_t)bytes, (int64_t)size, (int64_t)(intptr_t)fault, FAULT_SIZE, 0};
    if (!proximity_call(set, FAULT_IN_HEADER, words)) {
        return proximity_no_memory(error, "to look at the file");
    }
    if (words[4] != SOUND) {
        return proximity_refuse_kind(error, words[4], fault, "", NULL);
    }
    const char *begin = (const char *)bytes + HEADER_SIZE;
    Text document = {begin, begin + fault[0]}, layout, arrays, metadata, parts, names;
    int64_t data_at = HEADER_SIZE + fault[0];
    if (data_at % PAGE != 0 || !find(document, "layout", &layout) || !find(document, "arrays", &arrays) ||
        !find(document, "metadata", &metadata) || !find(metadata, "parts", &parts) || !find(parts, "name", &names)) {
        return proximity_refuse(error, PROXIMITY_BAD_FILE,
                                "its description cannot be understood; save the scene again with this version");
    }
    size_t length = strlen(proximity_layout);
    if ((size_t)(layout.end - layout.at) != length || memcmp(layout.at, proximity_layout, length) != 0) {
        Text version, quoted;
        if (!find(document, "version", &quoted) || !read_string(&quoted, &version)) {
            version = (Text){"unknown", NULL};
            version.end = version.at + strlen(version.at);
        }
        return proximity_refuse(error, PROXIMITY_BAD_VERSION,
                                "it was saved by version %.*s, expected " PACKAGE_VERSION ": the layout of trees differs; "
                                "save the scene again with this version", (int)(version.end - version.at), version.at);
    }
    int code = read_arrays(set, arrays, bytes + data_at, (int64_t)size - data_at, archive, error);
    if (code == PROXIMITY_OK) {
        code = read_names(names, archive);
        if (code == PROXIMITY_NO_MEMORY) {
            return proximity_refuse(error, code, "there is no memory for the names of parts");
        }
        if (code != PROXIMITY_OK) {
            return proximity_refuse(error, code, "the names of its parts cannot be understood");
        }
    }
    return code;
}
