/* The frame of an HTML page: its styles, escaped text, embedded pictures. */
#include "study/page.h"

#include <stdbool.h>
#include <stdlib.h>

static const char style[] =
    "*{box-sizing:border-box}"
    "html{-webkit-text-size-adjust:100%}"
    "body{margin:0;background:#fbfaf8;color:#1f2328;"
    "font:16px/1.55 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif}"
    "main{max-width:64rem;margin:0 auto;padding:1.5rem 1.1rem 3rem}"
    "header{border-bottom:3px solid #1a5e8c;padding-bottom:1rem;margin-bottom:1.4rem}"
    "h1{font-size:1.9rem;line-height:1.2;margin:0 0 .35rem;letter-spacing:-.01em;"
    "overflow-wrap:anywhere}"
    "h2{font-size:1.25rem;margin:2.6rem 0 .4rem}"
    "p{margin:.4rem 0 .8rem;max-width:46rem}"
    "code{overflow-wrap:anywhere}"
    ".muted,figcaption{color:#5b6470;font-size:.86rem;line-height:1.45}"
    ".key{display:grid;grid-template-columns:repeat(auto-fit,minmax(9.5rem,1fr));gap:.7rem;"
    "margin:1.2rem 0 0}"
    ".key div{background:#fff;border:1px solid #e3e0da;border-radius:.5rem;padding:.65rem .85rem}"
    ".key b{display:block;font-size:1.5rem;line-height:1.25;font-weight:650;"
    "font-variant-numeric:tabular-nums}"
    ".key span{color:#5b6470;font-size:.82rem;line-height:1.35;display:block}"
    ".two{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,22rem),1fr));"
    "gap:1.1rem}"
    ".three{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,16rem),1fr));"
    "gap:1.1rem}"
    "figure{margin:0;background:#fff;border:1px solid #e3e0da;border-radius:.5rem;padding:.75rem}"
    "figcaption{margin-top:.55rem}"
    "figure svg,figure img{display:block;width:100%;height:auto}"
    "svg text{font-family:inherit;font-size:11px;fill:#4a525c}"
    "svg .name{font-weight:600;fill:#1f2328}"
    "svg .label{stroke:#fff;stroke-width:2px;paint-order:stroke;stroke-linejoin:round}"
    ".pixels{image-rendering:pixelated}"
    ".point{display:grid;grid-template-columns:1fr 1fr 1.45fr;gap:.8rem;align-items:start}"
    ".point+.point{margin-top:1rem;padding-top:1rem;border-top:1px solid #ece9e3}"
    ".point h3{grid-column:1/-1;font-size:.95rem;margin:0}"
    ".point h3 b{display:inline-block;width:1.6rem;height:1.6rem;line-height:1.6rem;"
    "border-radius:50%;background:#1f2328;color:#fff;text-align:center;margin-right:.4rem}"
    ".point h3 span{font-weight:400;color:#5b6470}"
    ".point p{margin:.25rem 0 0;text-align:center}"
    ".scroll{overflow-x:auto}"
    ".numbers td{white-space:nowrap}"
    /* A command stays in sight where its table is wider than the screen, and is not broken within an option. */
    ".command code{display:block;white-space:normal;position:sticky;left:.6rem;"
    "max-width:min(58rem,100vw - 6.4rem)}"
    ".command i{font-style:normal;white-space:nowrap}"
    "table{border-collapse:collapse;width:100%;background:#fff;font-size:.9rem;"
    "font-variant-numeric:tabular-nums}"
    "th,td{border:1px solid #e3e0da;padding:.45rem .6rem;text-align:left;vertical-align:top}"
    "th{background:#f1efea;font-weight:600;font-size:.82rem;line-height:1.3}"
    ".legend{display:flex;flex-wrap:wrap;gap:.2rem .9rem;margin-top:.5rem;font-size:.82rem;"
    "color:#4a525c}"
    ".legend i{display:inline-block;width:.8rem;height:.8rem;border-radius:.15rem;"
    "margin-right:.35rem;vertical-align:-.08rem}"
    ".legend .line{height:2px;vertical-align:.25rem}"
    ".warn{border-left:4px solid #d9772b;background:#fff6ec;padding:.6rem .9rem;"
    "border-radius:0 .4rem .4rem 0}"
    ".warn p{margin:.2rem 0}"
    "@media(max-width:40rem){h1{font-size:1.5rem}.point{grid-template-columns:1fr 1fr}"
    ".point>div:last-child{grid-column:1/-1}}"
    "@media print{@page{margin:14mm}body{background:#fff;font-size:10.5pt}main{padding:0 1px;"
    "max-width:none}figure,.key div,.point,tr,.short{break-inside:avoid}.command "
    "code{position:static;max-width:none}h2,h2+p,h3{break-after:avoid}"
    ".two{grid-template-columns:1fr 1fr;gap:4mm}.three{grid-template-columns:1fr 1fr 1fr;gap:4mm}"
    ".key{grid-template-columns:repeat(5,1fr);gap:3mm}.key b{font-size:14pt}h2{margin-top:7mm}"
    ".point{grid-template-columns:1fr 1fr 1.45fr}.point>div:last-child{grid-column:auto}"
    "figure.long{break-inside:auto}"
    ".scroll{overflow:visible}table{font-size:8pt}th,td{padding:.25rem .35rem}"
    "*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}";

static void write_character(FILE *page, char character)
{
    switch (character) {
    case '&':
        (void)fputs("&amp;", page);
        break;
    case '<':
        (void)fputs("&lt;", page);
        break;
    case '>':
        (void)fputs("&gt;", page);
        break;
    case '"':
        (void)fputs("&quot;", page);
        break;
    case '\'':
        (void)fputs("&#39;", page);
        break;
    default:
        (void)putc(character, page);
    }
}

void page_text(FILE *page, const char *text)
{
    for (; *text; text++) {
        write_character(page, *text);
    }
}

void page_command(FILE *page, const char *command)
{
    bool option = false;
    bool begins = true; /* a word */
    for (; *command; command++) {
        if (*command == ' ' && option) {
            (void)fputs("</i>", page);
            option = false;
        } else if (*command == '-' && begins) {
            (void)fputs("<i>", page);
            option = true;
        }
        begins = *command == ' ';
        write_character(page, *command);
    }
    (void)fputs(option ? "</i>" : "", page);
}

void page_begin(FILE *page, const char *title)
{
    (void)fputs("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
                "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>",
                page);
    page_text(page, title);
    (void)fprintf(page, "</title>\n<style>%s</style>\n</head>\n<body>\n<main>\n", style);
}

void page_end(FILE *page)
{
    (void)fputs("</main>\n</body>\n</html>\n", page);
}

static void write_base64(FILE *page, const unsigned char *bytes, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < size; i += 3) {
        size_t left = size - i;
        unsigned word = (unsigned)bytes[i] << 16;
        word |= left > 1 ? (unsigned)bytes[i + 1] << 8 : 0;
        word |= left > 2 ? (unsigned)bytes[i + 2] : 0;
        (void)putc(digits[word >> 18], page);
        (void)putc(digits[word >> 12 & 63], page);
        (void)putc(left > 1 ? digits[word >> 6 & 63] : '=', page);
        (void)putc(left > 2 ? digits[word & 63] : '=', page);
    }
}

int page_picture(FILE *page, const struct picture *picture, struct nacre_error *error)
{
    unsigned char *bytes = NULL;
    size_t size = 0;
    int status = picture_encode_png(picture, &bytes, &size, error);
    if (status == NACRE_OK) {
        (void)fputs("data:image/png;base64,", page);
        write_base64(page, bytes, size);
    }
    free(bytes);
    return status;
}
