// @MARK@ flamenco. The job type of shots of Meniscus: copy it to the folder `scripts` next to flamenco-manager.
//
// A shot is simulated by one task; what is made of its frames, in chunks by many; then every file is verified. A task that is
// run again keeps what is valid.

const JOB_TYPE = {
    label: "Meniscus Shot",
    settings: [
        { key: "folder", type: "string", subtype: "dir_path", required: true,
          description: "Shot folder with its preset.toml, or folder of wedges; the same path on all workers" },
        { key: "frames", type: "string", required: true, eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          description: "Frames to simulate. Examples: '1-240', '1-240x2', '1,5,9-12'" },
        { key: "chunk_size", type: "int32", default: 10, propargs: { min: 1 },
          description: "Frames of a task that makes meshes or volumes" },
        { key: "products", type: "string", default: "mesh --format ply",
          description: "What to make of the frames, separated by ';'; 'once' before what one task makes of all frames" },
        { key: "options", type: "string", default: "", visible: "web",
          description: "Arguments of every task, such as '--threads 8'" },
        { key: "simulate_options", type: "string", default: "", visible: "web",
          description: "More arguments of the simulation, such as '--max-memory 4GiB'" },
        { key: "shots", type: "string", default: "", visible: "web",
          description: "Names of the wedges below the folder, separated by blanks; empty: the folder is a shot" },
        { key: "meniscus", type: "string", default: "meniscus", visible: "web",
          description: "The program on the workers" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    for (const key of ["folder", "meniscus"]) {
        if (/[{}]/.test(settings[key])) {
            throw `${key}: found a brace in "${settings[key]}", which Flamenco would take for a variable`;
        }
    }
    const root = settings.folder.length > 1 ? settings.folder.replace(/[\\/]+$/, "") : settings.folder;
    const shots = words(settings.shots);
    const ends = [];
    for (const shot of shots.length > 0 ? shots : [""]) {
        ends.push(authorShot(job, shot === "" ? root : `${root}/${shot}`, shot === "" ? "" : `${shot}: `));
    }
    if (shots.length > 0) {
        add(job, "contact sheet", ["wedge", root], ends);
    }
}

// Adds the tasks of a shot and returns the last one.
function authorShot(job, folder, prefix) {
    const settings = job.settings;
    const simulate = add(job, `${prefix}simulate ${settings.frames}`,
        ["simulate", `${folder}/preset.toml`, "-o", folder, "--frames", settings.frames,
            ...words(settings.simulate_options)], []);
    const made = [];
    for (const product of settings.products.split(";").map(words).filter((list) => list.length > 0)) {
        const once = product[0] === "once";
        const [verb, ...rest] = once ? product.slice(1) : product;
        for (const frames of once ? [settings.frames] : chunksOf(settings.frames, settings.chunk_size)) {
            made.push(add(job, `${prefix}${verb} ${frames}`,
                [verb, folder, ...rest, "--frames", frames], [simulate]));
        }
    }
    return add(job, `${prefix}verify`, ["verify", folder], made.length > 0 ? made : [simulate]);
}

// Adds a task with one command that runs after others.
function add(job, name, args, after) {
    const task = author.Task(name, "misc");
    task.addCommand(author.Command("exec", {
        exe: job.settings.meniscus,
        args: [...args, ...words(job.settings.options), "--progress", "plain"],
    }));
    for (const other of after) {
        task.addDependency(other);
    }
    job.addTask(task);
    return task;
}

function words(text) {
    return (text || "").split(/\s+/).filter((word) => word.length > 0);
}

// The frames of each chunk, as --frames takes them.
function chunksOf(text, size) {
    const all = [];
    for (const part of text.split(",")) {
        const found = /^\s*(\d+)(?:\s*-\s*(\d+)(?:\s*x\s*(\d+))?)?\s*$/.exec(part);
        const step = found ? Number(found[3] || 1) : 0;
        if (step === 0) {
            throw `frames: found "${part}", expected ranges such as 1-240, 1-240x2 or 1,5,9-12`;
        }
        const first = Number(found[1]);
        const last = found[2] === undefined ? first : Number(found[2]);
        if (first > last || (all.length > 0 && first <= all[all.length - 1])) {
            throw `frames: found "${part}", expected frames in ascending order`;
        }
        if ((last - first) / step + all.length > 1000000) {
            throw "frames: expected at most a million";
        }
        for (let frame = first; frame <= last; frame += step) {
            all.push(frame);
        }
    }
    if (!(size >= 1)) {
        throw `chunk_size: found ${size}, expected 1 or more`;
    }
    const chunks = [];
    for (let start = 0; start < all.length; start += size) {
        chunks.push(rangesOf(all.slice(start, start + size)));
    }
    return chunks;
}

// Ascending frames as ranges: one with a step where they are at equal distances.
function rangesOf(frames) {
    const step = frames.length > 1 ? frames[1] - frames[0] : 1;
    if (step > 1 && frames.every((frame, place) => frame === frames[0] + place * step)) {
        return `${frames[0]}-${frames[frames.length - 1]}x${step}`;
    }
    const ranges = [];
    for (const frame of frames) {
        const range = ranges[ranges.length - 1];
        if (range && range[1] + 1 === frame) {
            range[1] = frame;
        } else {
            ranges.push([frame, frame]);
        }
    }
    return ranges.map(([first, last]) => (first === last ? `${first}` : `${first}-${last}`)).join(",");
}
