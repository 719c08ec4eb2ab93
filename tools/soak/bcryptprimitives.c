// Debian 12's wine lacks the library from which a Rust program for Windows takes its random numbers; this is that one function.
__declspec(dllimport) unsigned char __stdcall SystemFunction036(void *bytes, unsigned long count);

__declspec(dllexport) int __stdcall ProcessPrng(unsigned char *bytes, unsigned long long count) {
    while (count > 0) {
        unsigned long part = count > 1ul << 20 ? 1ul << 20 : (unsigned long)count;
        if (!SystemFunction036(bytes, part)) return 0;
        bytes += part;
        count -= part;
    }
    return 1;
}
