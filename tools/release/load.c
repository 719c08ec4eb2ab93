// SPDX-License-Identifier: MIT OR Apache-2.0
// Loads the library of a wheel and calls its functions as meniscus_fx/_native.py does: prints hashes of the columns of a mesh, and
// messages, which are the same on every system. For systems whose Python does not run here; tools/release/check.py compares.
//
//     load LIBRARY        writes load.ply into the current folder
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#endif

typedef struct { const void *data; size_t len; } Text;
typedef struct { Text name; uint32_t kind; const void *data; } InputColumn;
typedef struct {
    size_t particles;
    const InputColumn *columns;
    size_t column_count;
    double spacing;
    Text quality;
    const Text *settings;
    size_t setting_count, threads;
    uint64_t max_memory;
    void *cancel;
} Request;
typedef struct { Text name; uint32_t kind; size_t len; const void *data; } Column;

static void *function(const char *path, const char *name) {
#ifdef _WIN32
    HMODULE library = LoadLibraryA(path);
    void *found = library ? (void *)GetProcAddress(library, name) : NULL;
#else
    void *library = dlopen(path, RTLD_NOW);
    void *found = library ? dlsym(library, name) : NULL;
#endif
    if (!found) {
        printf("%s: %s is not there\n", path, library ? name : "the library");
        exit(1);
    }
    return found;
}

int main(int count, char **words) {
    if (count != 2) return 2;
#define FUNCTION(result, name, ...) result (*name)(__VA_ARGS__) = (result (*)(__VA_ARGS__))function(words[1], "meniscus_" #name)
    FUNCTION(uint32_t, abi, void);
    FUNCTION(Text, version, void);
    FUNCTION(void *, cancel_new, void);
    FUNCTION(void, cancel_set, void *);
    FUNCTION(void, cancel_free, void *);
    FUNCTION(void *, reconstruct, const Request *);
    FUNCTION(uint32_t, outcome_status, void *);
    FUNCTION(Text, outcome_text, void *);
    FUNCTION(size_t, outcome_column_count, void *);
    FUNCTION(Column, outcome_column, void *, size_t);
    FUNCTION(void *, outcome_write, void *, Text);
    FUNCTION(void, outcome_free, void *);

    Text text = version();
    printf("interface %u, version %.*s\n", abi(), (int)text.len, (const char *)text.data);
    static float positions[1000][3];
    for (int i = 0; i < 1000; i++) {
        positions[i][0] = 0.05f * (i % 10);
        positions[i][1] = 0.05f * (i / 10 % 10);
        positions[i][2] = 0.05f * (i / 100);
    }
    InputColumn column = {{"position", 8}, 2, positions};
    void *flag = cancel_new();
    Request request = {1000, &column, 1, 0.05, {"final", 5}, NULL, 0, 0, 0, flag};
    void *outcome = reconstruct(&request), *failure;
    printf("status %u\n", outcome_status(outcome));
    for (size_t i = 0; i < outcome_column_count(outcome); i++) {
        Column found = outcome_column(outcome, i);
        size_t bytes = found.len * (found.kind == 1 || found.kind == 3 ? 4 : 12);
        uint64_t hash = 14695981039346656037u;  // FNV-1a
        for (size_t j = 0; j < bytes; j++) hash = (hash ^ ((const unsigned char *)found.data)[j]) * 1099511628211u;
        printf("%.*s %u %016llx\n", (int)found.name.len, (const char *)found.name.data, (unsigned)found.len, (unsigned long long)hash);
    }
    failure = outcome_write(outcome, (Text){"load.stl", 8});
    text = outcome_text(failure);
    printf("status %u, %.*s\n", outcome_status(failure), (int)text.len, (const char *)text.data);
    outcome_free(failure);
    printf("written %d\n", outcome_write(outcome, (Text){"load.ply", 8}) == NULL);
    outcome_free(outcome);
    cancel_set(flag);
    outcome = reconstruct(&request);
    printf("cancelled: status %u\n", outcome_status(outcome));
    outcome_free(outcome);
    request.spacing = -1;
    outcome = reconstruct(&request);
    text = outcome_text(outcome);
    printf("status %u, %.*s\n", outcome_status(outcome), (int)text.len, (const char *)text.data);
    outcome_free(outcome);
    request.spacing = 0.05, request.max_memory = 1000000;
    outcome = reconstruct(&request);
    text = outcome_text(outcome);
    printf("status %u, %.*s\n", outcome_status(outcome), (int)text.len, (const char *)text.data);
    outcome_free(outcome);
    cancel_free(flag);
    return 0;
}
