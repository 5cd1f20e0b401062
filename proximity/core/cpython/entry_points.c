/* Calls from Python to compiled kernels: validate arguments, split them into words, and combine results.
   An entry point is a builtin function whose `self` is a capsule with its description. It takes exactly the
   types that its signature declares: others are a TypeError. A bundle is an object that keeps arrays alive
   and has their addresses and lengths ready. */
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#define NPY_NO_DEPRECATED_API NPY_1_22_API_VERSION
#include <numpy/arrayobject.h>

#include <stdlib.h>
#include <string.h>

#include "entry_points.h"

enum { MAX_AXES = 4, MAX_VALUES = 24, MAX_WORDS = 96 };
enum { INT, FLOAT, BOOL, ARRAY, BUNDLE };
enum { RECORD_SIZE = 256 }; /* factor of the size in the code of a record type */
enum { ANSWERED = -1 }; /* result of a query that has answered all rows */

typedef struct {
    int kind;
    int number; /* of an array its dtype, see type_number; of a bundle its kind */
    int axes;
    int64_t lengths[MAX_AXES]; /* -1: any */
} Value;

typedef struct {
    Wrapper wrapper;
    char *name;
    int argument_count, result_count, argument_words;
    Py_ssize_t rows_with_gil; /* rows of the first array up to which the interpreter stays locked */
    /* For a query: rows are its second, and perhaps its third argument. */
    int row_arrays, width, dtype;
    Py_ssize_t few;     /* rows from which Python takes over */
    PyObject *otherwise; /* answers all other calls */
    Value values[MAX_VALUES]; /* arguments, then results */
} Entry;

typedef struct {
    PyObject_HEAD
    PyObject *arrays; /* a tuple */
    int64_t kind;
    int64_t words[MAX_WORDS];
} Bundle;

static PyTypeObject *bundle_type;

/* --- arguments ---------------------------------------------------------------------------------------- */

static int value_words(const Value *value)
{
    return value->kind == ARRAY ? 1 + value->axes : 1;
}

static int refuse(const char *name, Py_ssize_t k, const Value *value, PyObject *given)
{
    static const char *kinds[] = {"int", "float", "bool", "array", "bundle of arrays"};
    if (value->kind == ARRAY && PyArray_Check(given)) {
        PyObject *wanted = (PyObject *)PyArray_DescrFromType(value->number % RECORD_SIZE);
        PyErr_Format(PyExc_TypeError,
                     "%s: argument %zd is an array with %d axes and dtype %S, expected %d axes, dtype %S, C "
                     "order and the lengths that its signature says",
                     name, k, PyArray_NDIM((PyArrayObject *)given), PyArray_DESCR((PyArrayObject *)given),
                     value->axes, wanted);
        Py_XDECREF(wanted);
        return 0;
    }
    PyErr_Format(PyExc_TypeError, "%s: argument %zd is %R, expected %s of its signature", name, k,
                 (PyObject *)Py_TYPE(given), kinds[value->kind]);
    return 0;
}

static inline int type_number(PyArrayObject *array)
{
    int number = PyArray_TYPE(array);
    return number == NPY_VOID ? number + RECORD_SIZE * (int)PyArray_ITEMSIZE(array) : number;
}

/* The words of an array; 0 if it is not as declared. */
static inline int array_words(const Value *value, PyObject *given, int64_t *words)
{
    if (!PyArray_Check(given)) {
        return 0;
    }
    PyArrayObject *array = (PyArrayObject *)given;
    if (type_number(array) != value->number || PyArray_NDIM(array) != value->axes ||
        !PyArray_CHKFLAGS(array, NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED) || !PyArray_ISNOTSWAPPED(array)) {
        return 0;
    }
    words[0] = (int64_t)PyArray_DATA(array);
    for (int axis = 0; axis < value->axes; axis++) {
        words[1 + axis] = PyArray_DIM(array, axis);
        if (value->lengths[axis] >= 0 && value->lengths[axis] != words[1 + axis]) {
            return 0;
        }
    }
    return 1;
}

static inline int take(const Entry *entry, Py_ssize_t k, PyObject *given, int64_t *words)
{
    const Value *value = &entry->values[k];
    double real;
    switch (value->kind) {
    case ARRAY:
        if (array_words(value, given, words)) {
            return 1;
        }
        break;
    case BUNDLE:
        if (Py_TYPE(given) == bundle_type && ((Bundle *)given)->kind == value->number) {
            words[0] = (int64_t)((Bundle *)given)->words;
            return 1;
        }
        break;
    case FLOAT:
        real = PyFloat_AsDouble(given);
        if (real != -1.0 || !PyErr_Occurred()) {
            memcpy(words, &real, sizeof real);
            return 1;
        }
        PyErr_Clear();
        break;
    default: /* integers and booleans, including NumPy's */
        words[0] = given == Py_True ? 1 : given == Py_False ? 0 : PyLong_AsLongLong(given);
        if (words[0] != -1 || !PyErr_Occurred()) {
            return 1;
        }
        if (PyErr_ExceptionMatches(PyExc_OverflowError)) {
            return 0;
        }
        PyErr_Clear();
        PyObject *whole = PyNumber_Index(given);
        if (whole != NULL) {
            words[0] = PyLong_AsLongLong(whole);
            Py_DECREF(whole);
            return words[0] != -1 || !PyErr_Occurred();
        }
        PyErr_Clear();
        if (PyArray_IsScalar(given, Bool)) {
            words[0] = PyObject_IsTrue(given);
            return 1;
        }
    }
    return refuse(entry->name, k, value, given);
}

/* --- results ------------------------------------------------------------------------------------------ */

static void forget(PyObject *capsule)
{
    release_owner(PyCapsule_GetPointer(capsule, NULL));
}

static PyObject *array_of(const Value *value, const int64_t *words)
{
    npy_intp lengths[MAX_AXES];
    for (int axis = 0; axis < value->axes; axis++) {
        lengths[axis] = (npy_intp)words[1 + axis];
    }
    Owner *owner = (Owner *)words[1 + value->axes];
    PyObject *capsule = PyCapsule_New(owner, NULL, forget);
    if (capsule == NULL) {
        release_owner(owner);
        return NULL;
    }
    PyObject *array = PyArray_New(&PyArray_Type, value->axes, lengths, value->number, NULL, (void *)words[0], 0,
                                  NPY_ARRAY_CARRAY, NULL);
    if (array == NULL || PyArray_SetBaseObject((PyArrayObject *)array, capsule) < 0) {
        if (array == NULL) {
            Py_DECREF(capsule);
        }
        Py_XDECREF(array);
        return NULL;
    }
    return array;
}

static PyObject *object_of(const Value *value, const int64_t *words)
{
    double real;
    switch (value->kind) {
    case ARRAY:
        return array_of(value, words);
    case FLOAT:
        memcpy(&real, words, sizeof real);
        return PyFloat_FromDouble(real);
    case BOOL:
        return PyBool_FromLong((long)(words[0] & 1));
    default:
        return PyLong_FromLongLong(words[0]);
    }
}

static PyObject *results_of(const Entry *entry, const int64_t *words)
{
    const Value *values = entry->values + entry->argument_count;
    if (entry->result_count == 0) {
        Py_RETURN_NONE;
    }
    if (entry->result_count == 1) {
        return object_of(values, words);
    }
    PyObject *results = PyTuple_New(entry->result_count);
    for (int k = 0; results != NULL && k < entry->result_count; k++) {
        PyObject *result = object_of(&values[k], words);
        if (result == NULL || PyTuple_SetItem(results, k, result) < 0) {
            Py_CLEAR(results);
        }
        words += value_words(&values[k]) + (values[k].kind == ARRAY);
    }
    return results;
}

/* --- calls -------------------------------------------------------------------------------------------- */

static int ask(const Entry *entry, int64_t *words, Py_ssize_t rows)
{
    void *unused[2] = {NULL, NULL};
    int status;
    if (rows <= entry->rows_with_gil) {
        status = entry->wrapper(&unused[0], &unused[1], (int64_t)words);
    } else {
        Py_BEGIN_ALLOW_THREADS
        status = entry->wrapper(&unused[0], &unused[1], (int64_t)words);
        Py_END_ALLOW_THREADS
    }
    if (status != 0) {
        PyErr_NoMemory();
        return 0;
    }
    return 1;
}

static PyObject *call(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    const Entry *entry = PyCapsule_GetPointer(self, NULL);
    int64_t words[MAX_WORDS];
    Py_ssize_t at = 0, rows = -1;
    if (count != entry->argument_count) {
        PyErr_Format(PyExc_TypeError, "%s takes %d arguments, %zd were given", entry->name, entry->argument_count,
                     count);
        return NULL;
    }
    for (Py_ssize_t k = 0; k < count; k++) {
        if (!take(entry, k, arguments[k], words + at)) {
            return NULL;
        }
        if (rows < 0 && entry->values[k].kind == ARRAY) {
            rows = (Py_ssize_t)words[at + 1];
        }
        at += value_words(&entry->values[k]);
    }
    return ask(entry, words, rows) ? results_of(entry, words + at) : NULL;
}

static PyMethodDef call_definition = {"entry", (PyCFunction)(void (*)(void))call, METH_FASTCALL, NULL};

/* --- queries ------------------------------------------------------------------------------------------ */

static PyObject *packed_name, *one;

/* The table of answers to a small batch of plain rows; NULL without an exception for other arguments. */
static PyObject *ask_few(const Entry *entry, PyObject *const *arguments)
{
    int64_t words[MAX_WORDS];
    double limit = PyFloat_CheckExact(arguments[1 + entry->row_arrays])
                       ? PyFloat_AsDouble(arguments[1 + entry->row_arrays]) : -1.0;
    if (!(limit >= 0.0) || arguments[2 + entry->row_arrays] != one) {
        return NULL;
    }
    Py_ssize_t at = 1, rows = -1;
    for (int k = 0; k < entry->row_arrays; k++) {
        const Value *value = &entry->values[1 + k];
        /* Python handles subclasses, which may hide values, such as masked arrays. */
        PyObject *given = arguments[1 + k];
        if (!PyArray_CheckExact(given) || !array_words(value, given, words + at) ||
            (k > 0 && words[at + 1] != rows)) {
            return NULL;
        }
        rows = (Py_ssize_t)words[at + 1];
        at += value_words(value);
    }
    if (rows >= entry->few) {
        return NULL;
    }
    PyObject *packed = PyObject_GetAttr(arguments[0], packed_name);
    if (packed == NULL || !take(entry, 0, packed, words)) {
        Py_XDECREF(packed);
        return NULL;
    }
    npy_intp lengths[2] = {rows, entry->width};
    PyObject *table = PyArray_EMPTY(entry->width > 1 ? 2 : 1, lengths, entry->dtype, 0);
    if (table != NULL) {
        words[at++] = 0; /* no order */
        words[at++] = 0;
        words[at++] = (int64_t)&limit;
        words[at++] = 1;
        words[at++] = (int64_t)PyArray_DATA((PyArrayObject *)table);
        words[at++] = rows;
        words[at++] = entry->width;
        if (!ask(entry, words, rows) || words[at] != ANSWERED) {
            Py_CLEAR(table);
        }
    }
    Py_DECREF(packed); /* the caller keeps the model alive */
    return table;
}

static PyObject *call_query(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    const Entry *entry = PyCapsule_GetPointer(self, NULL);
    if (count == entry->row_arrays + 3) {
        PyObject *table = ask_few(entry, arguments);
        if (table != NULL || PyErr_Occurred()) {
            return table;
        }
    }
    PyObject *rest = PyTuple_New(count);
    if (rest == NULL) {
        return NULL;
    }
    for (Py_ssize_t k = 0; k < count; k++) {
        Py_INCREF(arguments[k]);
        PyTuple_SetItem(rest, k, arguments[k]);
    }
    PyObject *answer = PyObject_Call(entry->otherwise, rest, NULL);
    Py_DECREF(rest);
    return answer;
}

static PyMethodDef query_definition = {"query", (PyCFunction)(void (*)(void))call_query, METH_FASTCALL, NULL};

/* --- making entries and bundles ----------------------------------------------------------------------- */

/* Read the codes of a value: kind, number, axes, lengths; return 0 with an exception if they are invalid. */
static int read_value(PyObject *codes, Value *value)
{
    int64_t numbers[3 + MAX_AXES];
    Py_ssize_t count = PyTuple_Check(codes) ? PyTuple_Size(codes) : 0;
    if (count < 3 || count > 3 + MAX_AXES) {
        PyErr_SetString(PyExc_ValueError, "a value is described by 3 to 7 whole numbers");
        return 0;
    }
    for (Py_ssize_t k = 0; k < count; k++) {
        numbers[k] = PyLong_AsLongLong(PyTuple_GetItem(codes, k));
        if (numbers[k] == -1 && PyErr_Occurred()) {
            return 0;
        }
    }
    value->kind = (int)numbers[0];
    value->number = (int)numbers[1];
    value->axes = (int)(count - 3);
    for (int axis = 0; axis < value->axes; axis++) {
        value->lengths[axis] = numbers[3 + axis];
    }
    return 1;
}

static void free_entry(PyObject *capsule)
{
    Entry *entry = PyCapsule_GetPointer(capsule, NULL);
    Py_XDECREF(entry->otherwise);
    free(entry->name);
    free(entry);
}

static Wrapper wrapper_named(const char *instructions, const char *name)
{
    for (const NamedEntry *each = named_entries; each->name != NULL; each++) {
        if (strcmp(each->instructions, instructions) == 0 && strcmp(each->name, name) == 0) {
            return each->wrapper;
        }
    }
    PyErr_Format(PyExc_LookupError, "there is no entry point %s for %s", name, instructions);
    return NULL;
}

/* A capsule with the description of an entry point. */
static PyObject *described(PyObject *arguments)
{
    const char *instructions, *name;
    PyObject *taken, *given;
    Py_ssize_t rows_with_gil;
    if (!PyArg_ParseTuple(arguments, "ssO!O!n", &instructions, &name, &PyTuple_Type, &taken, &PyTuple_Type,
                          &given, &rows_with_gil)) {
        return NULL;
    }
    Entry *entry = calloc(1, sizeof(Entry));
    if (entry == NULL) {
        return PyErr_NoMemory();
    }
    int words = 0;
    entry->wrapper = wrapper_named(instructions, name);
    entry->name = strdup(name);
    entry->rows_with_gil = rows_with_gil;
    entry->argument_count = (int)PyTuple_Size(taken);
    entry->result_count = (int)PyTuple_Size(given);
    int is_right = entry->wrapper != NULL && entry->name != NULL &&
                   entry->argument_count + entry->result_count <= MAX_VALUES;
    for (int k = 0; is_right && k < entry->argument_count + entry->result_count; k++) {
        int is_result = k >= entry->argument_count;
        PyObject *codes = is_result ? PyTuple_GetItem(given, k - entry->argument_count) : PyTuple_GetItem(taken, k);
        is_right = read_value(codes, &entry->values[k]);
        words += value_words(&entry->values[k]) + is_result;
        if (!is_result) {
            entry->argument_words = words;
        }
    }
    if (!is_right || words > MAX_WORDS) {
        free(entry->name);
        free(entry);
        if (!PyErr_Occurred()) {
            PyErr_Format(PyExc_ValueError, "%s has more values than an entry point can take", name);
        }
        return NULL;
    }
    return PyCapsule_New(entry, NULL, free_entry);
}

static PyObject *make_entry(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *capsule = described(arguments);
    if (capsule == NULL) {
        return NULL;
    }
    PyObject *entry = PyCFunction_NewEx(&call_definition, capsule, NULL);
    Py_DECREF(capsule);
    return entry;
}

/* A query: an entry point, the number of its arrays of rows, the size of an answer, and the fallback. */
static PyObject *make_query(PyObject *self, PyObject *arguments)
{
    (void)self;
    PyObject *description, *otherwise;
    int row_arrays, width, dtype;
    Py_ssize_t few;
    if (!PyArg_ParseTuple(arguments, "O!iiinO", &PyTuple_Type, &description, &row_arrays, &width, &dtype, &few,
                          &otherwise)) {
        return NULL;
    }
    PyObject *capsule = described(description);
    if (capsule == NULL) {
        return NULL;
    }
    Entry *entry = PyCapsule_GetPointer(capsule, NULL);
    entry->row_arrays = row_arrays;
    entry->width = width;
    entry->dtype = dtype;
    entry->few = few;
    Py_INCREF(otherwise);
    entry->otherwise = otherwise;
    PyObject *query = PyCFunction_NewEx(&query_definition, capsule, NULL);
    Py_DECREF(capsule);
    return query;
}

static PyObject *make_bundle(PyObject *self, PyObject *arguments)
{
    (void)self;
    const char *name;
    long long kind;
    PyObject *codes, *arrays;
    if (!PyArg_ParseTuple(arguments, "sLO!O!", &name, &kind, &PyTuple_Type, &codes, &PyTuple_Type, &arrays)) {
        return NULL;
    }
    Py_ssize_t count = PyTuple_Size(codes), at = 0;
    if (PyTuple_Size(arrays) != count) {
        PyErr_Format(PyExc_TypeError, "%s has %zd arrays, %zd were given", name, count, PyTuple_Size(arrays));
        return NULL;
    }
    allocfunc allocate = (allocfunc)PyType_GetSlot(bundle_type, Py_tp_alloc);
    Bundle *bundle = (Bundle *)allocate(bundle_type, 0);
    if (bundle == NULL) {
        return NULL;
    }
    bundle->kind = kind;
    for (Py_ssize_t k = 0; k < count; k++) {
        Value value;
        PyObject *array = PyTuple_GetItem(arrays, k);
        int is_right = read_value(PyTuple_GetItem(codes, k), &value);
        if (is_right && at + value_words(&value) > MAX_WORDS) {
            PyErr_Format(PyExc_ValueError, "%s has more arrays than a bundle can hold", name);
            is_right = 0;
        } else if (is_right && !array_words(&value, array, bundle->words + at)) {
            is_right = refuse(name, k, &value, array);
        }
        if (!is_right) {
            Py_DECREF(bundle);
            return NULL;
        }
        at += value_words(&value);
    }
    Py_INCREF(arrays);
    bundle->arrays = arrays;
    return (PyObject *)bundle;
}

static void free_bundle(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    Py_XDECREF(((Bundle *)self)->arrays);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(self);
    Py_DECREF(type);
}

static PyType_Slot bundle_slots[] = {
    {Py_tp_dealloc, free_bundle}, {Py_tp_doc, "Arrays that compiled code takes together."}, {0, NULL}};
static PyType_Spec bundle_spec = {"proximity.native._kernels.Bundle", sizeof(Bundle), 0,
                                  Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION, bundle_slots};

/* Names of the compiled instruction sets that this processor has. */
static PyObject *usable_instructions(PyObject *self, PyObject *unused)
{
    (void)self, (void)unused;
    PyObject *names = PyList_New(0);
    const char *last = "";
    for (const NamedEntry *each = named_entries; names != NULL && each->name != NULL; each++) {
        if (strcmp(each->instructions, last) != 0 && has_instructions(each->instructions)) {
            PyObject *name = PyUnicode_FromString(each->instructions);
            if (name == NULL || PyList_Append(names, name) < 0) {
                Py_CLEAR(names);
            }
            Py_XDECREF(name);
        }
        last = each->instructions;
    }
    return names;
}

static PyMethodDef methods[] = {
    {"make_entry", make_entry, METH_VARARGS, "Return the function of an entry point."},
    {"make_query", make_query, METH_VARARGS, "Return the function of a query."},
    {"make_bundle", make_bundle, METH_VARARGS, "Return arrays as one argument."},
    {"usable_instructions", usable_instructions, METH_NOARGS, "Return the sets of instructions to choose from."},
    {NULL, NULL, 0, NULL}};

static int execute(PyObject *module)
{
    if (PyArray_ImportNumPyAPI() < 0) {
        return -1;
    }
    packed_name = PyUnicode_InternFromString("packed");
    one = PyLong_FromLong(1); /* a singleton */
    if (bundle_type == NULL) {
        bundle_type = (PyTypeObject *)PyType_FromSpec(&bundle_spec);
    }
    if (bundle_type == NULL || PyModule_AddStringConstant(module, "digest_in_c", digest_in_c) < 0 ||
        PyModule_AddStringConstant(module, "entry_signatures", entry_signatures) < 0) {
        return -1;
    }
    return PyModule_AddStringConstant(module, "sources_digest", sources_digest);
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, execute},
#ifdef Py_mod_gil
                                          {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
                                          {0, NULL}};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "_kernels", "Kernels that were compiled ahead of time.", 0, methods, module_slots,
    NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernels(void)
{
    return PyModuleDef_Init(&module);
}
